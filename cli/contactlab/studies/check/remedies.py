"""Changes that help a model, each run on the model itself together with those before it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from contactlab.errors import ContactlabError, OutputError, StoppedError
from contactlab.run.evidence_record import as_written
from contactlab.scene.setting_values import as_number
from contactlab.schema.check_report import CheckName, CheckResult, Finding, Remedy
from contactlab.studies.check.check_results import findings_of, settings_text
from contactlab.studies.check.check_runner import CheckRunner
from contactlab.studies.check.contact_margin_check import stiffer, touch_only
from contactlab.studies.check.file_edits import edits_of
from contactlab.studies.check.flat_contact_check import stiffer_rest
from contactlab.studies.check.free_motion_check import steadier
from contactlab.studies.check.hold_check import hold_remedies
from contactlab.studies.check.timestep_check import shorter_timestep
from contactlab.studies.session import Values

Check = Callable[[CheckRunner], CheckResult]
_Proposal = Callable[[CheckRunner, CheckResult], Iterator[Values]]


def _hold(measure: str) -> _Proposal:
    return lambda runner, _: hold_remedies(runner, measure)


_PROPOSALS: Mapping[str, _Proposal] = {
    **{name: _hold(name) for name in ("steps_lost", "mode_switches")},
    **dict.fromkeys(("timestep", "step_ratio", "travel"), shorter_timestep),
    **dict.fromkeys(("energy_gain", "energy_drift"), steadier),
    **dict.fromkeys(("penetration_steady", "penetration_growth"), stiffer_rest),
    **{name: _hold(name) for name in ("slip", "penetration_mean")},
    "shell": touch_only,
    "softness": stiffer,
}
"""What to try against each measure that misses its limit, in the order in which it is tried."""

_MOVES_FREELY = {"timestep", "integrator", "gravity"}
"""Settings on which free motion depends, where contacts are off."""

_ROUNDS = 5


@dataclass
class _Search:
    """A search for changes that help, each on top of those that were found.

    Attributes:
        runner: runs the model as it is.
        results: of each check, with the changes that were found.
        found: these changes, and the findings that each mends.
    """

    checks: Mapping[CheckName, Check]
    runner: CheckRunner
    results: dict[CheckName, CheckResult]
    found: list[tuple[Values, tuple[str, ...]]] = field(
        default_factory=list[tuple[Values, tuple[str, ...]]]
    )
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
        now = self.runner.trying(self.settings, "remedies/now")
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
        runner = self.runner.trying(settings, f"remedies/{self.trials}")
        results: dict[CheckName, CheckResult] = {}
        results[finding.check] = self.checks[finding.check](runner)
        if finding.name in (failing := _failing(results)):
            return failing[finding.name].message
        results |= self._others(runner, proposal, finding.check)
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

    def _others(
        self, runner: CheckRunner, proposal: Values, but: CheckName
    ) -> Iterator[tuple[CheckName, CheckResult]]:
        """Yield the results of all other checks, those as they were that nothing changes."""
        for name, check in self.checks.items():
            moves = name != "free_motion" or _MOVES_FREELY & proposal.keys()
            if name != but:
                same = name == "repeat" or not moves
                yield name, self.results[name] if same else check(runner)

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
    runner: CheckRunner,
    results: Sequence[CheckResult],
    aims: Sequence[str],
) -> tuple[tuple[Remedy, ...], list[str]]:
    """Return changes that mend findings of these names, and notes of what does not help."""
    search = _Search(checks, runner, {each.name: each for each in results})
    for name in _PROPOSALS:
        if name in aims:
            search.mend(name)
    times = _times(runner, [settings for settings, _ in search.found]) if search.found else []
    return tuple(map(partial(_remedy, runner), search.found, times)), search.notes


def _remedy(
    runner: CheckRunner, found: tuple[Values, tuple[str, ...]], time: float | None
) -> Remedy:
    settings, mends = found
    return Remedy(
        settings={name: as_written(value) for name, value in settings.items()},
        mends=mends,
        time=time,
        edits=edits_of(runner.checked.changed(settings), settings),
    )


def _times(runner: CheckRunner, changes: Sequence[Values]) -> list[float | None]:
    """Return the CPU time of stepping with each change and those before it, over that without."""
    rows: list[Values] = [{"timestep": runner.checked.resolved.timestep}]
    for settings in changes:
        rows.append({**rows[-1], **settings})
    runs = runner.trying({}, "remedies").run(
        "times", "What the remedies cost", rows, trace="none", timing={"rounds": _ROUNDS}
    )
    times = [each.record.timing and each.record.timing.time_min for each in runs]
    return [each / times[0] if each and times[0] else None for each in times[1:]]
