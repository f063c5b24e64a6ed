"""The gallery: each hard case with what it expects, and, on request, with films and its page."""

import html
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

import contactlab
from contactlab.measure import LABELS
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.view.render import PictureOptions, render_run

_CASES = sorted((Path(__file__).parents[2] / "sweeps/stability").glob("*.yaml"))
_STATIC = "_static/gallery"
_SIZE = (320, 240)
_SECONDS = 4.0  # that a film takes, whatever its run takes
_INTRODUCTION = """# Hard cases

What `contactlab stability` runs: scenes whose outcome is known, by a closed form or by what stays
the same, and controls among them that must fail. Each says what it expects, and why.
"""


def write(source: Path, *, films: bool) -> tuple[str, ...]:
    """Write the page, and its films beside it; return its name."""
    media = source / _STATIC
    media.mkdir()
    lines = (line for case in _CASES for line in _case(case, media, films=films))
    (source / "gallery.md").write_text("\n".join([_INTRODUCTION, *lines]) + "\n", encoding="utf-8")
    return ("gallery",)


def _case(case: Path, media: Path, *, films: bool) -> Iterator[str]:
    sweep: dict[str, Any] = YAML(typ="safe").load(case)
    yield f"\n## {case.stem}\n\n{sweep['description']}.\n"
    if films:
        yield from _films(case, media)
    for each in sweep.get("expect", ()):
        where = ", ".join(f"{name} {value}" for name, value in each.get("where", {}).items())
        label = f"**{each['label']}**: " if "label" in each else ""
        yield f"- {f'`{where}`: ' if where else ''}{label}{each.get('reason', '')}"


def _films(case: Path, media: Path) -> Iterator[str]:
    """Film the worst run and a stable one, and write the page of all runs."""
    results = media.parents[2] / "results" / case.stem
    store = contactlab.sweep(case, output=results, set={"trace": "all"})
    contactlab.report(store, output=media / f"{case.stem}.html")
    yield '```{raw} html\n<div class="gallery">'
    for record in _shown(store):
        film = media / f"{case.stem}-{record.run_id}.mp4"
        speed = max(0.001, record.duration / _SECONDS)
        render_run(store, record.run_id, film, PictureOptions(size=_SIZE, speed=speed))
        reason = html.escape(record.labels[0].reason)
        yield f'<figure><video src="../{_STATIC}/{film.name}" controls muted loop></video>'
        yield f"<figcaption><b>{record.label}</b> {reason}</figcaption></figure>"
    yield "</div>"
    yield f'<p><a href="../{_STATIC}/{case.stem}.html">All {len(store.runs)} runs</a></p>\n```\n'


def _shown(store: Store) -> list[EvidenceRecord]:
    """Return the run with the worst label and the one with the best; one, if all are alike."""
    places = {name: place for place, name in enumerate(reversed(LABELS))}
    ranked = sorted(store.records(), key=lambda record: places[record.label])
    return ranked[:1] if ranked[0].label == ranked[-1].label else [ranked[-1], ranked[0]]
