"""Changes that help a model, each run on the model itself together with those before it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from contactlab.errors import ContactlabError, OutputError, SceneError, StoppedError
from contactlab.scene.model_draft import Change, ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.schema.check_report import CheckResult, Edit, Remedy
from contactlab.schema.finding import Finding
from contactlab.schema.setting_values import as_number
from contactlab.store.table_layout import as_written
from contactlab.studies.check.check_entries import CHECKS, REMEDIES, Check
from contactlab.studies.check.check_results import MODEL, findings_of, settings_text
from contactlab.studies.check.checked_model import CheckedModel, TooLongError
from contactlab.studies.session import Values

_FIRST = ("steps_lost", "mode_switches")
"""Findings against which changes are tried before those against others, in the order of limits."""

_MOVES_FREELY = {"timestep", "integrator", "gravity"}
"""Settings on which free motion depends, where contacts are off."""

_ROUNDS = 5
_Found = tuple[Values, tuple[str, ...]]


@dataclass
class _Search:
    """A search for changes that help, each on top of those that were found."""

    checks: Mapping[str, Check]
    model: CheckedModel  # as it is
    results: dict[str, CheckResult]  # of each check, with these changes
    # The changes that were found, and the findings that each mends.
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
        for proposal in REMEDIES[name].propose(now, self.results[finding.kind]):
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
        results: dict[str, CheckResult] = {}
        results[finding.kind] = self.checks[finding.kind](changed)
        if finding.name in (failing := _failing(results)):
            return failing[finding.name].message
        for name, check in self.checks.items():
            still = name == "free_motion" and not _MOVES_FREELY & proposal.keys()
            if name != finding.kind:
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
        same = [entry for entry in self.found if entry[0].keys() & proposal.keys()]
        names = {name for changes, _ in same for name in changes} | proposal.keys()
        mends = [mend for _, earlier in same for mend in earlier] + list(mended)
        self.found = [entry for entry in self.found if entry not in same]
        whole = {name: settings[name] for name in settings if name in names}
        self.found.append((whole, tuple(dict.fromkeys(mends))))


def _failing(results: Mapping[str, CheckResult]) -> dict[str, Finding]:
    found = (finding for result in results.values() for finding in findings_of(result))
    return {finding.name: finding for finding in found if finding.failing}


def _merged(settings: Values, proposal: Values) -> dict[str, object]:
    """Return settings with a change; of two timesteps, the shorter."""
    merged = {**settings, **proposal}
    if "timestep" in settings and "timestep" in proposal:
        merged["timestep"] = min(as_number(settings["timestep"]), as_number(proposal["timestep"]))
    return merged


def find_remedies(
    checks: Mapping[str, Check],
    checked: CheckedModel,
    results: Sequence[CheckResult],
    aims: Sequence[str],
) -> tuple[tuple[Remedy, ...], list[str]]:
    """Return changes that mend findings of these names, and notes of what does not help."""
    search = _Search(checks, checked, {result.name: result for result in results})
    limited = (limit.name for check in CHECKS.values() for limit in check.limits)
    for name in dict.fromkeys((*_FIRST, *limited)):
        if name in aims and name in REMEDIES:
            search.mend(name)
    times: list[float | None] = [None] * len(search.found)
    try:
        times = _times(checked, [settings for settings, _ in search.found]) if times else []
    except TooLongError as error:
        search.notes.append(f"what the changes cost was not measured: {error}")
    edits = _edits(checked, [settings for settings, _ in search.found], search.notes)
    remedies = tuple(
        Remedy(
            settings={name: as_written(value) for name, value in settings.items()},
            mends=mends,
            time=time,
            edits=edit,
        )
        for (settings, mends), time, edit in zip(search.found, times, edits, strict=True)
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
    times = [run.record.timing and run.record.timing.time_min for run in runs]
    return [seconds / times[0] if seconds and times[0] else None for seconds in times[1:]]


def _edits(
    checked: CheckedModel, changes: Sequence[Values], notes: list[str]
) -> list[tuple[Edit, ...]]:
    """Write the model with each change and those before; return what each adds, or note why not."""
    whole: dict[str, object] = {}
    edits: list[tuple[Edit, ...]] = []
    before: tuple[Change, ...] = ()
    for settings in changes:
        try:
            with_it = ModelEdits({**whole, **settings})
            after = write_model(checked.scene, with_it, checked.session.folder / MODEL).changes
        except SceneError as error:
            notes.append(f"{settings_text(settings)} is in no file of the model: {error}")
            edits.append(())
            continue
        new = [element for element in after if element not in before]
        edits.append(tuple(Edit(where=element.where, lines=(element.element,)) for element in new))
        whole, before = {**whole, **settings}, after
    return edits
