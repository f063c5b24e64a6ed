"""Writes the page that simulates: runs, models and MuJoCo's WebAssembly build in one HTML file."""

import base64
import gzip
import hashlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from contactlab.errors import ContactlabError, OutputError
from contactlab.live.browser_build import BrowserBuild, find_build
from contactlab.live.browser_models import (
    BrowserModel,
    array_difference,
    model_changes,
    shown_groups,
)
from contactlab.live.live_runs import LiveRun, LiveRuns, Slider, Switch, Variant
from contactlab.live.sliders import value_text
from contactlab.live.surfaces import Texture
from contactlab.measure import LABELS
from contactlab.page.header_films import film_of
from contactlab.page.packing import as_json, pack_columns, packed_text
from contactlab.page.page_template import fill_template
from contactlab.printable import visible
from contactlab.resources import read_style
from contactlab.scene.timed_inputs import Signals
from contactlab.schema.examination import Examination
from contactlab.store.atomic_files import atomic_write
from contactlab.store.finished_store import Store

MOST_BYTES = 16_000_000


def write_live_page(
    store: Store,
    target: Path,
    run_ids: Sequence[str] = (),
    examination: Examination | None = None,
) -> tuple[str, ...]:
    """Write runs of a store as an offline page that simulates them; return the others' reasons.

    Without ids there is a run of each label, the worst first. Runs of an examination's task have
    its sentence, and its budget's rows and changes as switches. A StoreError says that there is no
    such run; an OutputError that the browser's part is not built, that the page is larger than 16
    MB, or that it cannot be written.
    """
    build = find_build()
    runs = LiveRuns(store, examination)
    chosen = [runs.run(run) for run in run_ids or _representative_runs(store)]
    document = _PageContent(build, runs)
    page = document.of(store, chosen)
    text = fill_template("live.html", Path(__file__).parent, **page)
    size = len(text.encode())
    if size > MOST_BYTES:
        raise OutputError(
            f"the page has {size / 1e6:.0f} MB, but at most {MOST_BYTES / 1e6:.0f} are allowed; "
            "choose fewer runs with --run, or a model with smaller meshes"
        )
    with atomic_write(target) as temporary:
        temporary.write_bytes(text.encode())
    return tuple(f"run {entry['id']}: {entry['why']}" for entry in document.entries if entry["why"])


def _representative_runs(store: Store) -> list[str]:
    labels = store.columns.read_codes("label")
    ranks = {name: place for place, name in enumerate(LABELS)}
    worst = np.array([ranks.get(str(name), len(ranks)) for name in labels.values])[labels.codes]
    order = np.argsort(worst, kind="stable")
    leaders = order[np.unique(worst[order], return_index=True)[1]]
    most_runs = 8
    chosen = list(dict.fromkeys([*leaders.tolist(), *order.tolist()]))[:most_runs]
    return [store.columns.run_id(row) for row in chosen]


@dataclass
class _PageContent:
    """The content of the page: JSON, and compressed models."""

    build: BrowserBuild
    runs: LiveRuns
    entries: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])  # of the runs
    _blobs: list[str] = field(default_factory=list[str])
    _inputs: dict[bytes, int] = field(default_factory=dict[bytes, int])
    _input_entries: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    @cached_property
    def _has_same_version(self) -> bool:
        """Whether the browser's MuJoCo has the version that compiles the models here."""
        return self.build.mujoco == mujoco.__version__

    def of(self, store: Store, chosen: Sequence[LiveRun]) -> dict[str, Any]:
        """Return the values for the template of the page."""
        self.entries += [self._run_entry(store, run) for run in chosen]
        examined = self.runs.examination
        name = Path(examined.model).name if examined else store.manifest.sweep.name
        bits = {"disable": mujoco.mjtDisableBit, "enable": mujoco.mjtEnableBit}
        data = {
            "store": name,
            "engine": self.build.mujoco,
            "runs": self.entries,
            "models": [self._model_entry(place) for place in range(len(self.runs.models))],
            "inputs": self._input_entries,
            "flags": {
                f"opt.{kind}flags": {
                    name.partition("_")[2].lower(): int(bit)
                    for name, bit in members.__members__.items()
                    if not name.startswith("mjN")
                }
                for kind, members in bits.items()
            },
        }
        style = read_style("live")
        scripts, styles = (
            "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
            for text in (self.build.script, style)
        )
        return {
            "title": visible(f"{name}, simulated"),
            "hashes": {"script": scripts, "style": styles},
            "style": style,
            "script": self.build.script,
            "data": packed_text(as_json(data)),
            "engine": base64.b64encode(self.build.engine).decode(),
            "blobs": self._blobs,
            "contactlab": version("contactlab"),
            "mujoco": self.build.mujoco,
            "licences": self.build.licences,
        }

    def _add_blob(self, data: bytes) -> int:
        level = 9
        self._blobs.append(base64.b64encode(gzip.compress(data, level, mtime=0)).decode())
        return len(self._blobs) - 1

    def _model_entry(self, place: int) -> dict[str, Any]:
        browser_model: BrowserModel = self.runs.models[place]
        entry: dict[str, Any] = {
            "geoms": [visible(name) for name in self.runs.geom_names(place)],
            "mjcf": browser_model.mjcf,
            "textures": [self._texture_entry(texture) for texture in browser_model.textures],
        }
        if self._has_same_version:
            return entry | {"bytes": self._add_blob(browser_model.compiled)}
        if not browser_model.mjcf:
            return entry
        text, files = browser_model.standalone_mjcf
        return entry | {
            "alone": text,
            "files": {name: self._add_blob(data) for name, data in files.items()},
            "numbers": pack_columns(browser_model.numbers),
        }

    def _texture_entry(self, texture: Texture) -> dict[str, Any]:
        entry: dict[str, Any] = {
            "material": texture.material,
            "mean": texture.mean,
            "repeat": texture.repeat,
            "uniform": texture.uniform,
        }
        if texture.picture is None:
            return entry
        height, width, _ = texture.picture.shape
        blob = self._add_blob(texture.picture.tobytes())
        return entry | {"width": width, "height": height, "blob": blob}

    def _run_entry(self, store: Store, run: LiveRun) -> dict[str, Any]:
        record = run.record
        reasons = [
            f"{visible(each.label)}: {visible(each.reason)}" if each.label != "stable" else "stable"
            for each in record.labels
        ]
        examined = self.runs.examination
        sentences = (examined.headline, *examined.why) if examined else ()
        entry: dict[str, Any] = {
            "id": record.run_id,
            "label": visible(record.label),
            "reasons": [*map(visible, sentences), *reasons],
            "axes": [[visible(name), value_text(value)] for name, value in record.axes.items()],
            "version": record.engine.version,
            "notes": [visible(note) for note in run.notes],
            "why": visible(run.why),
        }
        if run.motion:
            (qpos, qvel), times = run.motion.end, run.motion.times
            poses = {"times": times, "poses": run.motion.qpos.ravel().astype(np.float32)}
            entry |= {
                "end": pack_columns({"qpos": qpos, "qvel": qvel}),
                "ghost": pack_columns(poses),
            }
        why = run.why or self._unreadable_reason(run)
        if run.variant is None or run.variant.model.nplugin or self._unreadable_reason(run):
            film = None
            with suppress(ContactlabError):
                film = next((film.source for film in film_of(store, record.run_id)), None)
            return entry | {"why": visible(why), "film": film}
        base = self.runs.models[run.variant.base].model
        return entry | {
            **self._variant_entry(run.variant, base),
            "sliders": [self._slider_entry(slider, run.variant) for slider in run.sliders],
            "switches": list(
                filter(None, (_switch_entry(each, run.variant) for each in run.switches))
            ),
        }

    def _unreadable_reason(self, run: LiveRun) -> str:
        """Return the reason why the browser's MuJoCo cannot read a run's model; empty if it can."""
        if run.variant is None or self._has_same_version or self.runs.models[run.variant.base].mjcf:
            return ""
        return (
            f"its model is stored as MuJoCo {mujoco.__version__} compiled it, which "
            f"{self.build.mujoco} does not read"
        )

    def _variant_entry(self, variant: Variant, base: mujoco.MjModel) -> dict[str, Any]:
        return {
            "model": variant.base,
            "fields": model_changes(base, variant.model) | shown_groups(base),
            "parts": pack_columns(variant.parts),
            "inputs": self._input_place(variant),
            "steps": variant.steps,
        }

    def _slider_entry(self, slider: Slider, run: Variant) -> dict[str, Any]:
        return {
            "name": visible(slider.name),
            "unit": slider.unit,
            "own": slider.own,
            "stops": [
                {"text": visible(stop.text), **self._stop_entry(stop, run)} for stop in slider.stops
            ],
        }

    def _stop_entry(self, stop: Variant, run: Variant) -> dict[str, Any]:
        """Return the differences of a variant from its run; all of it for another structure."""
        if stop.base != run.base:
            return self._variant_entry(stop, self.runs.models[stop.base].model)
        parts = {
            name: array_difference(run.parts[name], value)
            for name, value in stop.parts.items()
            if value.tobytes() != run.parts[name].tobytes()
        }
        entry = {
            "fields": model_changes(run.model, stop.model),
            "moved": parts,
            "steps": stop.steps,
        }
        inputs = self._input_place(stop)
        return entry if inputs == self._input_place(run) else entry | {"inputs": inputs}

    def _input_place(self, variant: Variant) -> int | None:
        """Return the place of the inputs that change over time; None if none do."""
        signals = variant.start.signals[0]
        if not signals.places.size:
            return None
        key = b"".join(part.tobytes() for part in signals_of(signals))
        if key not in self._inputs:
            self._inputs[key] = len(self._input_entries)
            self._input_entries.append(
                {
                    "places": signals.places.tolist(),
                    "knots": signals.levels.shape[1],
                    **pack_columns(
                        {"times": signals.times.ravel(), "levels": signals.levels.ravel()}
                    ),
                }
            )
        return self._inputs[key]


def _switch_entry(switch: Switch, run: Variant) -> dict[str, Any] | None:
    """Return the changes of a switch; None for no change, or for another structure."""
    if switch.variant.base != run.base or not (
        fields := model_changes(run.model, switch.variant.model)
    ):
        return None
    words = {name: visible(getattr(switch, name)) for name in ("kind", "name", "summary")}
    return {
        **words,
        "told": visible(switch.finding),
        "fields": fields,
        "steps": switch.variant.steps,
    }


def signals_of(signals: Signals) -> tuple[np.ndarray, ...]:
    """Return the arrays that determine signals."""
    return signals.places, signals.times, signals.levels
