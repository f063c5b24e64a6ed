"""Ablation: which effects a scene needs, what each costs, and the smallest set that will do."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from contactlab.run.job import Progress
from contactlab.run.provenance import engine, provenance
from contactlab.run.record import as_written
from contactlab.run.stop import Stop
from contactlab.scene import EFFECTS
from contactlab.schema import (
    EffectFinding,
    EffectsReport,
    Need,
    Ratio,
    Setting,
    SmallestSet,
    Verification,
)
from contactlab.studies.effects.changes import Difference, difference
from contactlab.studies.effects.costs import cost_ratio, work_ratios
from contactlab.studies.effects.lines import mjcf_lines, sweep_lines
from contactlab.studies.effects.question import Question, Values
from contactlab.studies.effects.search import Search, exempted, merged
from contactlab.studies.effects.toggles import Toggle, find_toggles
from contactlab.studies.effects.trials import BASE, Changed, Outcome, Trials

FRESH_SEEDS = 10
# Matched pairs that are timed; the range of six holds the median in 97 of 100 cases.
_PAIRS = 6
# An effect is added only if that leaves at most this share of the time.
_CHEAPER = 0.95


@dataclass(frozen=True)
class Ablation:
    """How an ablation is run.

    Attributes:
        question: what is asked.
        folder: where the stores go.
        workers: processes.
        begin: told how many runs a store has, and how many of them are done already.
        progress: told of runs as they finish.
        rounds: how often runs are timed; None leaves costs out.
        stop: set when it should end soon; None if it never should.
    """

    question: Question
    folder: Path
    workers: int
    begin: Callable[[int, int], None]
    progress: Progress
    rounds: int | None = 3
    stop: Stop | None = None

    def report(self) -> EffectsReport:
        """Change one effect at a time, search for the smallest set, and verify it."""
        question = self.question
        toggles = {each.effect: each for each in find_toggles(question)}
        trials = self._trials(toggles)
        singles, proven = _singles(toggles), _proven(toggles)
        asked = [BASE, *singles.values(), *([proven] if proven else [])]
        outcomes = trials.run("one-by-one", "One effect changed at a time", asked)
        timed = _timed(trials, "timing", asked)
        findings = [_finding(question, toggles[name], outcomes, timed, proven) for name in toggles]
        search = Search(trials, outcomes[BASE])
        free = search.smallest(proven, _worthwhile(findings))
        needed = [each.effect for each in findings if each.need == "needed"]
        free, interactions = search.interactions(free, needed)
        saving = _timed(trials, "saving", [BASE, free]) if free else {}
        return EffectsReport(
            scene=question.scene.name,
            scene_hash=question.scene.hash,
            source=question.source,
            base=_written(question.base),
            scenarios=tuple(_written(each) for each in question.scenarios),
            seeds=question.seeds,
            duration=question.duration or question.scene.duration,
            tolerances=dict(question.tolerances),
            engine=engine(),
            provenance=provenance(),
            effects=tuple(findings),
            interactions=interactions,
            smallest_set=_set(toggles, free, proven),
            saving=cost_ratio(saving[BASE], saving[free]) if free else None,
            verification=_verified(trials, free),
            stores=tuple(trials.stores),
        )

    def _trials(self, toggles: Mapping[str, Toggle]) -> Trials:
        return Trials(
            question=self.question,
            toggles=toggles,
            folder=self.folder,
            workers=self.workers,
            begin=self.begin,
            progress=self.progress,
            rounds=self.rounds,
            stop=self.stop,
        )


def _singles(toggles: Mapping[str, Toggle]) -> dict[str, Changed]:
    return {name: (name,) for name, each in toggles.items() if each.proof is None}


def _proven(toggles: Mapping[str, Toggle]) -> Changed:
    return merged([name for name, each in toggles.items() if each.proof is not None])


def _timed(
    trials: Trials, name: str, asked: Sequence[Changed], seeds: Sequence[int] | None = None
) -> dict[Changed, Outcome]:
    """Time configurations in turns, in at most so many matched pairs of each with the base."""
    question = trials.question
    scenarios = question.scenarios[:: max(1, len(question.scenarios) // _PAIRS)][:_PAIRS]
    count = max(1, _PAIRS // len(scenarios))
    picked = (question.seeds if seeds is None else seeds)[:count]
    about = "Configurations timed in turns"
    return trials.run(name, about, asked, seeds=picked, scenarios=scenarios, timed=True)


def _finding(
    question: Question,
    toggle: Toggle,
    outcomes: Mapping[Changed, Outcome],
    timed: Mapping[Changed, Outcome],
    proven: Changed,
) -> EffectFinding:
    """Return what is found of one effect; those that are unused by proof were changed at once."""
    changed = proven if toggle.proof is not None else (toggle.effect,)
    exempt = exempted(changed, question.tolerances)
    found = difference(question, question.scenarios, outcomes[BASE], outcomes[changed], exempt)
    cost = None if toggle.proof else cost_ratio(timed[BASE], timed[changed])
    effect = EFFECTS[toggle.effect]
    return EffectFinding(
        effect=toggle.effect,
        kind=effect.kind,
        what=effect.what,
        on=toggle.on,
        need=_need(toggle, found, cost),
        reason=toggle.proof or found.reason,
        settings=_written(toggle.values),
        changes=found.changes,
        within_spread=found.within_spread,
        labels=dict(found.labels),
        cost=cost,
        work={} if toggle.proof else work_ratios(timed[BASE], timed[changed]),
    )


def _need(toggle: Toggle, found: Difference, cost: Ratio | None) -> Need:
    if toggle.on:
        if found.matters:
            return "needed"
        return "free" if toggle.proof is None else "unused"
    if found.matters:
        return "absent"
    cheaper = cost is not None and cost.high < 1 and cost.ratio <= _CHEAPER
    return "saves" if cheaper else "idle"


def _worthwhile(findings: Sequence[EffectFinding]) -> list[str]:
    """Return the changes worth making, the most worthwhile first.

    What is numerical stays unless that saves time: most of it is there to save time, or to guard
    against settings that this scene does not have.
    """
    found = [each for each in findings if each.need == "saves" or _is_spare(each)]
    return [each.effect for each in sorted(found, key=_ratio)]


def _is_spare(finding: EffectFinding) -> bool:
    if finding.need != "free":
        return False
    cost = finding.cost
    return finding.kind != "numerical" or (cost is not None and cost.high < 1)


def _ratio(finding: EffectFinding) -> float:
    return 1.0 if finding.cost is None else finding.cost.ratio


def _set(toggles: Mapping[str, Toggle], free: Changed, proven: Changed) -> SmallestSet:
    settings: dict[str, object] = {}
    for name in free:
        settings |= toggles[name].values
    made = [name for name in free if toggles[name].values.items() <= settings.items()]
    present = [name for name, each in toggles.items() if each.on]
    return SmallestSet(
        on=tuple(sorted({*present} ^ {*made})),
        off=tuple(name for name in made if toggles[name].on),
        added=tuple(name for name in made if not toggles[name].on),
        settings=_written(settings),
        mjcf=mjcf_lines(settings),
        sweep=sweep_lines(settings, proven),
    )


def _verified(trials: Trials, free: Changed) -> Verification:
    """Run the smallest set and the base configuration from fresh seeds, in fresh scenarios."""
    question = trials.question
    first = max(question.seeds) + 1
    seeds, scenarios = tuple(range(first, first + FRESH_SEEDS)), question.fresh
    if not free:
        return Verification(
            seeds=seeds,
            scenarios=(),
            runs=0,
            holds=True,
            reason="nothing can be left out",
            cost=None,
        )
    about = "The smallest set against the base configuration, from fresh seeds"
    outcomes = trials.run("fresh", about, [BASE, free], seeds=seeds, scenarios=scenarios)
    exempt = exempted(free, question.tolerances)
    found = difference(question, scenarios, outcomes[BASE], outcomes[free], exempt)
    timed = _timed(trials, "fresh-timing", [BASE, free], seeds)
    return Verification(
        seeds=seeds,
        scenarios=tuple(_written(each) for each in scenarios),
        runs=len(outcomes[free].flat),
        holds=not found.matters,
        reason=found.reason,
        cost=cost_ratio(timed[BASE], timed[free]),
    )


def _written(values: Values) -> dict[str, Setting]:
    return {name: as_written(value) for name, value in values.items()}
