"""Expectations of scenes and sweeps, found for the contact pairs that a model monitors."""

from collections.abc import Mapping, Sequence

import numpy as np

from contactlab.contact.trace_setup import ExpectedContact
from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import entry_pairs
from contactlab.scene.model_names import matching, name_of
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.timed_inputs import computed, read_formula
from contactlab.schema.pair_expectation import ExpectedModes, PairExpectation
from contactlab.schema.scene_manifest import PairEntry, SceneManifest

Asked = tuple[PairExpectation | str, Sequence[bool]]
"""What a sweep expects, of pairs or in words, and of which of n runs."""

_ROUNDING = 1e-9
NEVER = (np.nan, np.nan)
"""The window of a run that nothing is said of."""


def expected_contacts(
    base: CompiledScene,
    manifest: SceneManifest | None,
    runs: Sequence[RunSpec],
    asked: Sequence[Asked],
) -> tuple[ExpectedContact, ...]:
    """Return what a scene expects of all of n runs of one structure, and a sweep of some."""
    own = list(manifest.pairs) if manifest else []
    if manifest and manifest.modes != ExpectedModes():
        own.insert(0, PairEntry(mode=manifest.modes))
    said = [
        (expectation, [_window(expectation, run.initial) for run in runs])
        for expectation in own
        if expectation.expects
    ]
    said += [
        (expectation, [_window(expectation, {}) if on else NEVER for on in where])
        for expectation, where in asked
        if isinstance(expectation, PairExpectation)
    ]
    return tuple(expected_contact(base, *expectation) for expectation in said)


def check_expectations(base: CompiledScene, manifest: SceneManifest) -> None:
    """Check what a manifest expects of pairs by its defaults; a SceneError says what is wrong."""
    initial = {name: setting.default for name, setting in manifest.initial.items()}
    for place, entry in enumerate(manifest.pairs):
        if mistake := mistake_in(entry, base, initial, manifest.duration):
            raise SceneError(f"pairs.{place}.{mistake[0]}: {mistake[1]}")


def mistake_in(
    entry: PairExpectation, base: CompiledScene, initial: Mapping[str, float], duration: float
) -> tuple[str, str] | None:
    """Return the key that is wrong in an expectation, and why; None if it fits scene and run."""
    if not _pairs_of(base, entry) and (pattern := entry.pair or entry.body):
        known = _names(base, entry)
        few = f"; write one of {', '.join(known)}" if 0 < len(known) <= 12 else ""
        hint = did_you_mean(pattern, known) or few
        return "pair" if entry.pair else "body", f"'{pattern}' names no monitored pair{hint}"
    try:
        start, stop = _window(entry, initial)
    except SceneError as error:
        return "to" if f"{error}".startswith("`to`") else "from", str(error)
    if not 0 <= start < duration:
        return "from", f"{start:g} s is not within the run, which takes {duration:g} s"
    if entry.stop is not None and not start < stop <= duration * (1 + _ROUNDING):
        return "to", f"{stop:g} s is not after {start:g} s and within the {duration:g} s of the run"
    return None


def expected_contact(
    base: CompiledScene, entry: PairExpectation, windows: Sequence[tuple[float, float]]
) -> ExpectedContact:
    """Return what an entry expects, in windows of n runs from when to when [s]."""
    chosen, mode, force = _pairs_of(base, entry), entry.mode, entry.force
    ends = mode if isinstance(mode, ExpectedModes) else ExpectedModes()
    alone = base.pairs[chosen[0]].name if len(chosen) == 1 else "every monitored pair"
    least, most = (force.min, force.max) if force else (None, None)
    return ExpectedContact(
        name=entry.body or entry.pair or alone,
        pairs=chosen,
        window=np.array(windows),
        timed=entry.start is not None or entry.stop is not None,
        mode=None if isinstance(mode, ExpectedModes) else mode,
        first=ends.first,
        last=ends.last,
        force=(-np.inf if least is None else least, np.inf if most is None else most),
        depth=entry.depth.max if entry.depth else np.inf,
    )


def _window(entry: PairExpectation, initial: Mapping[str, float]) -> tuple[float, float]:
    start, stop = (
        default if term is None else computed(read_formula(term, f"`{key}` goes", initial), initial)
        for term, key, default in ((entry.start, "from", 0.0), (entry.stop, "to", np.inf))
    )
    return start, stop


def _pairs_of(base: CompiledScene, entry: PairExpectation) -> tuple[int, ...]:
    """Return the indices of the monitored pairs that an expectation is about."""
    if isinstance(entry, PairEntry) and entry.monitors:
        own = {pair.name for pair in entry_pairs(base.model, entry)}
        return tuple(index for index, pair in enumerate(base.pairs) if pair.name in own)
    names = _names(base, entry)
    found = matching(names, entry.body or entry.pair or "*")
    return tuple(sorted({index for name in found for index in names[name]}))


def _names(base: CompiledScene, entry: PairExpectation) -> dict[str, list[int]]:
    """Return what an expectation may call pairs, with their indices: bodies, or two sides."""
    names: dict[str, list[int]] = {}
    for index, pair in enumerate(base.pairs):
        owners = [base.model.geom_bodyid[side[0]] for side in pair.geoms]
        bodies = [name_of(base.model, "body", owner) for owner in owners]
        sides = [pair.sides, bodies, pair.sides[::-1], bodies[::-1]]
        for name in dict.fromkeys(bodies if entry.body else map("-".join, sides)):
            names.setdefault(name, []).append(index)
    return names
