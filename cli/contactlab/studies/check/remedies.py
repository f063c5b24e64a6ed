"""Changes that help a model, each run on the model itself together with those before it.

What each changes in the model's file is tried by compiling a copy of the model with it.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco

from contactlab.errors import ContactlabError, OutputError, SceneError, StoppedError
from contactlab.mjcf import CONTACT, OPTIONS, attributes, default_lines, option_lines
from contactlab.run.evidence_record import as_written
from contactlab.scene.compile_model import compile_model
from contactlab.scene.contact_pairs import effective_parameters
from contactlab.scene.scene_source import SceneSource
from contactlab.scene.setting_values import as_number
from contactlab.schema.check_report import CheckName, CheckResult, Edit, Finding, Remedy
from contactlab.studies.check.check_results import findings_of, mjcf_text, settings_text
from contactlab.studies.check.checked_model import CheckedModel, TooLongError
from contactlab.studies.check.contact_checks import stiffer, stiffer_rest, touch_only
from contactlab.studies.check.free_motion_check import steadier
from contactlab.studies.check.hold_check import firmer, harder, shorter_steps
from contactlab.studies.check.timestep_check import shorter_timestep
from contactlab.studies.session import END, TOP, Values, paste

Check = Callable[[CheckedModel], CheckResult]
_Proposal = Callable[[CheckedModel, CheckResult], Iterator[Values]]


_PROPOSALS: Mapping[str, _Proposal] = {
    "steps_lost": shorter_steps,
    "mode_switches": harder,
    **dict.fromkeys(("timestep", "step_ratio", "travel"), shorter_timestep),
    **dict.fromkeys(("energy_gain", "energy_drift"), steadier),
    **dict.fromkeys(("penetration_steady", "penetration_growth"), stiffer_rest),
    **dict.fromkeys(("slip", "penetration_mean"), firmer),
    "shell": touch_only,
    "softness": stiffer,
}
"""What to try against each measure that misses its limit, in the order in which it is tried."""

_MOVES_FREELY = {"timestep", "integrator", "gravity"}
"""Settings on which free motion depends, where contacts are off."""

_ROUNDS = 5
_Found = tuple[Values, tuple[str, ...]]


@dataclass
class _Search:
    """A search for changes that help, each on top of those that were found.

    Attributes:
        model: as it is.
        results: of each check, with the changes that were found.
        found: these changes, and the findings that each mends.
    """

    checks: Mapping[CheckName, Check]
    model: CheckedModel
    results: dict[CheckName, CheckResult]
    found: list[_Found] = field(default_factory=list[_Found])
    notes: list[str] = field(default_factory=list[str])
    trials: int = 0

    @property
    def settings(self) -> dict[str, object]:
        """All changes that were found."""
        return {name: value for settings, _ in self.found for name, value in settings.items()}

    @property
    def failing(self) -> dict[str, Finding]:
        """The findings that still fail, by name."""
        return _failing(self.results)

    def mend(self, name: str) -> None:
        """Look for a change against a finding, unless it is mended already."""
        finding = self.failing.get(name)
        if finding is None:
            return
        now = self.model.trying(self.settings, "remedies/now")
        tried: list[str] = []
        for proposal in _PROPOSALS[name](now, self.results[finding.check]):
            text = settings_text(proposal)
            try:
                obstacle = self._obstacle(proposal, finding)
            except (StoppedError, OutputError):
                raise
            except ContactlabError as error:
                self.notes.append(f"{text} was not tried against {name}: {error}")
                continue
            if obstacle is None:
                return
            tried.append(f"{text} ({obstacle})")
        what = f"; tried: {', '.join(tried)}" if tried else ""
        self.notes.append(f"no change was found that mends {name}{what}")

    def _obstacle(self, proposal: Values, finding: Finding) -> str | None:
        """Run the model with a change; keep it, or return why not.

        It must mend a finding and break nothing, nor end what was held or stood.
        """
        self.trials += 1
        settings = _merged(self.settings, proposal)
        changed = self.model.trying(settings, f"remedies/{self.trials}")
        results: dict[CheckName, CheckResult] = {}
        results[finding.check] = self.checks[finding.check](changed)
        if finding.name in (failing := _failing(results)):
            return failing[finding.name].message
        for name, check in self.checks.items():
            still = name == "free_motion" and not _MOVES_FREELY & proposal.keys()
            if name != finding.check:
                same = name == "repeat" or still
                results[name] = self.results[name] if same else check(changed)
        failing, before = _failing(results), self.failing
        lost = [
            name
            for name, result in results.items()
            if result.verdict == "not applicable" != self.results[name].verdict
        ]
        if broken := [*lost, *(name for name in failing if name not in before)]:
            return f"breaks {' and '.join(broken)}"
        self.results = results
        self._keep(settings, proposal, tuple(name for name in before if name not in failing))
        return None

    def _keep(self, settings: Values, proposal: Values, mended: tuple[str, ...]) -> None:
        """Add a change; earlier ones that concern the same setting become part of it."""
        same = [each for each in self.found if each[0].keys() & proposal.keys()]
        names = {name for changes, _ in same for name in changes} | proposal.keys()
        mends = [each for _, earlier in same for each in earlier] + list(mended)
        self.found = [each for each in self.found if each not in same]
        whole = {name: settings[name] for name in settings if name in names}
        self.found.append((whole, tuple(dict.fromkeys(mends))))


def _failing(results: Mapping[CheckName, CheckResult]) -> dict[str, Finding]:
    found = (each for result in results.values() for each in findings_of(result))
    return {each.name: each for each in found if each.failing}


def _merged(settings: Values, proposal: Values) -> dict[str, object]:
    """Return settings with a change; of two timesteps, the shorter."""
    merged = {**settings, **proposal}
    if "timestep" in settings and "timestep" in proposal:
        merged["timestep"] = min(as_number(settings["timestep"]), as_number(proposal["timestep"]))
    return merged


def find_remedies(
    checks: Mapping[CheckName, Check],
    checked: CheckedModel,
    results: Sequence[CheckResult],
    aims: Sequence[str],
) -> tuple[tuple[Remedy, ...], list[str]]:
    """Return changes that mend findings of these names, and notes of what does not help."""
    search = _Search(checks, checked, {each.name: each for each in results})
    for name in _PROPOSALS:
        if name in aims:
            search.mend(name)
    times: list[float | None] = [None] * len(search.found)
    try:
        times = _times(checked, [settings for settings, _ in search.found]) if times else []
    except TooLongError as error:
        search.notes.append(f"what the changes cost was not measured: {error}")
    remedies = tuple(
        Remedy(
            settings={name: as_written(value) for name, value in settings.items()},
            mends=mends,
            time=time,
            edits=tuple(edits_of(checked.trying(settings, "remedies"), settings)),
        )
        for (settings, mends), time in zip(search.found, times, strict=True)
    )
    return remedies, search.notes


def _times(checked: CheckedModel, changes: Sequence[Values]) -> list[float | None]:
    """Return the CPU time of stepping with each change and those before it, over that without."""
    rows: list[Values] = [{"timestep": checked.resolved.timestep}]
    for settings in changes:
        rows.append({**rows[-1], **settings})
    # Fewer runs than were tried, and so not counted among these.
    priced = replace(checked.trying({}, "remedies"), brief=False)
    runs = priced.run(
        "times", "What the remedies cost", rows, trace="none", timing={"rounds": _ROUNDS}
    )
    times = [each.record.timing and each.record.timing.time_min for each in runs]
    return [each / times[0] if each and times[0] else None for each in times[1:]]


_MOST_NAMED = 12


def edits_of(checked: CheckedModel, settings: Values) -> Iterator[Edit]:
    """Yield the changes of a model's file that make settings, options before contact parameters.

    Lines are given only where a copy of the model with them compiles to the checked model, which
    has the settings; else the elements to change are named.
    """
    texts = {name: mjcf_text(value) for name, value in settings.items()}
    yield from _option_edits(checked, {name: texts[name] for name in OPTIONS if name in texts})
    yield from _contact_edits(checked, {name: texts[name] for name in CONTACT if name in texts})


def _option_edits(checked: CheckedModel, options: Mapping[str, str]) -> Iterator[Edit]:
    if not options:
        return
    edit = Edit(where=END, lines=tuple(option_lines(options, {})))
    model, expected = _compiled(checked.scene.source, edit), checked.prepared.model.opt
    if model and all(_equal(getattr(model.opt, each), getattr(expected, each)) for each in options):
        yield edit
    else:
        yield Edit(where="in the <option> element", lines=(attributes(options).strip(),))


def _contact_edits(checked: CheckedModel, contact: Mapping[str, str]) -> Iterator[Edit]:
    if not contact:
        return
    elements = ("geom", "pair") if checked.base.targets.explicit else ("geom",)
    lines = tuple(default_lines(contact, elements))
    for where in (TOP, END):
        edit = Edit(where=where, lines=lines)
        model = _compiled(checked.scene.source, edit)
        if model and _reaches(checked, model, contact):
            yield edit
            return
    yield Edit(where=_elements(checked), lines=(attributes(contact).strip(),))


def _elements(checked: CheckedModel) -> str:
    model, targets = checked.base.model, checked.base.targets
    geoms = [f"'{model.geom(each).name}'" for each in targets.geoms]
    named = ", ".join(geoms[:_MOST_NAMED])
    more = f" and {len(geoms) - _MOST_NAMED} more" if len(geoms) > _MOST_NAMED else ""
    pairs = f"the {len(targets.explicit)} <pair> elements" if targets.explicit else ""
    of_geoms = f"each of the geoms {named}{more}" if geoms else ""
    return "in " + " and ".join(filter(None, [of_geoms, pairs]))


def _reaches(checked: CheckedModel, model: mujoco.MjModel, names: Iterable[str]) -> bool:
    """Say whether a compiled model gives every monitored pair the parameters that were run."""
    wanted = checked.prepared.pairs
    found = {pair.name: effective_parameters(model, pair) for pair in checked.base.pairs}
    return all(
        _equal(getattr(found[pair], name), getattr(wanted[pair], name))
        for pair in wanted
        for name in names
    )


def _equal(some: object, other: object) -> bool:
    return mjcf_text(some) == mjcf_text(other)


def _compiled(source: SceneSource, edit: Edit) -> mujoco.MjModel | None:
    """Return a copy of the model with lines added; None if it does not compile, or is no MJCF."""
    with TemporaryDirectory(prefix="contactlab-") as folder:
        top, end = (edit.lines * (edit.where == where) for where in (TOP, END))
        try:
            copied = paste(source, Path(folder), top, end)
            return copied and compile_model(copied, {}, lambda _: None)
        except SceneError:
            return None
