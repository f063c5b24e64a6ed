"""Ablation: which effects a scene needs, what each costs, and the smallest set that will do."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

from contactlab.run.evidence_record import as_written, engine, provenance
from contactlab.scene import EFFECTS
from contactlab.schema import (
    EffectFinding,
    EffectsReport,
    Interaction,
    Need,
    Ratio,
    Setting,
    SmallestSet,
    Verification,
)
from contactlab.studies.effects.effect_toggles import (
    BASE,
    Changed,
    ConfigurationRows,
    ConfigurationRunner,
    Toggle,
    find_toggles,
    settings_mjcf,
    settings_sweep,
)
from contactlab.studies.effects.effects_request import AblationSetup, EffectsRequest
from contactlab.studies.effects.metric_changes import (
    ConfigurationDifference,
    cost_ratio,
    difference,
    unmeasured_metrics,
    work_ratios,
)
from contactlab.studies.session import Session, Values


@dataclass
class SmallestSetSearch:
    """Looks for the smallest set.

    Attributes:
        trials: runs configurations.
        base: the base configuration's outcome.
        tried: how many stores were written.
    """

    trials: ConfigurationRunner
    base: ConfigurationRows
    tried: int = field(default=0)

    def smallest(self, certain: Sequence[str], likely: Sequence[str]) -> Changed:
        """Return a largest set of changes that is free, found one by one.

        Args:
            certain: changes that are free by proof.
            likely: changes that are free one by one, the most worthwhile first.
        """
        everything = merged(certain, likely)
        if not everything or self._is_free(everything):
            return everything
        free = merged(certain) if certain and self._is_free(merged(certain)) else BASE
        rest = [each for each in (*certain, *likely) if each not in free]
        # What is refused beside later ones may be free beside earlier ones only, and stays out:
        # each step is checked against the base configuration, not against the step before.
        for name in rest:
            if self._is_free(merged(free, [name])):
                free = merged(free, [name])
        return free

    def interactions(
        self, free: Changed, needed: Sequence[str]
    ) -> tuple[Changed, tuple[Interaction, ...]]:
        """Try all pairs of what is needed one by one; return what is free with them, and all pairs.

        A pair is tried from one seed first; few pass that, and are tried from all.
        """
        pairs = list(combinations(needed, 2))
        if not pairs:
            return free, ()
        seed = self.trials.setup.seeds[:1]
        each_changed = {pair: merged(free, pair) for pair in pairs}
        outcomes = self._run([BASE, *each_changed.values()], seeds=seed)
        first = {
            pair: self._difference(changed, outcomes[BASE], outcomes[changed])
            for pair, changed in each_changed.items()
        }
        told: list[Interaction] = []
        for pair, found in first.items():
            passed = not found.matters and self._is_free(merged(free, pair))
            free = merged(free, pair) if passed else free
            told.append(Interaction(effects=pair, free=passed, reason=found.reason))
        return free, tuple(told)

    def _is_free(self, changed: Changed) -> bool:
        outcome = self._run([changed])[changed]
        return not self._difference(changed, self.base, outcome).matters

    def _run(
        self, configurations: Sequence[Changed], seeds: Sequence[int] | None = None
    ) -> Mapping[Changed, ConfigurationRows]:
        self.tried += 1
        return self.trials.run(
            f"search-{self.tried:02}", "Effects changed together", configurations, seeds=seeds
        )

    def _difference(
        self, changed: Changed, base: ConfigurationRows, other: ConfigurationRows
    ) -> ConfigurationDifference:
        setup = self.trials.setup
        exempt = exempted(changed, setup.tolerances)
        return difference(setup, setup.scenarios, base, other, exempt)


def merged(*names: Collection[str]) -> Changed:
    """Return the union of changes."""
    return tuple(sorted({name for each in names for name in each}))


def exempted(changed: Collection[str], given: Collection[str]) -> list[str]:
    """Return the metrics that cannot be measured without an effect, and that nobody asked for."""
    return [name for name in unmeasured_metrics(changed) if name not in given]


REPORT = "effects.json"
FRESH_SEEDS = 10
# Matched pairs that are timed; the range of six holds the median in 97 of 100 cases.
_PAIRS = 6
# An effect is added only if that leaves at most this share of the time.
_CHEAPER = 0.95


def run(request: EffectsRequest, session: Session) -> EffectsReport:
    """Change one effect at a time, search for the smallest set, and verify it.

    The report is written to `effects.json` beside the stores.

    Raises:
        SweepFileError: the sweep or a setting is wrong; all mistakes are named.
        SceneError: there is no such scene, or it does not compile.
        OutputError: the session's folder cannot be written.
        StoppedError: the session was stopped.
    """
    setup = request.setup
    toggles = {each.effect: each for each in find_toggles(setup)}
    trials = ConfigurationRunner(setup, toggles, session, request.rounds)
    singles, proven = _singles(toggles), _proven(toggles)
    configurations = [BASE, *singles.values(), *([proven] if proven else [])]
    outcomes = trials.run("one-by-one", "One effect changed at a time", configurations)
    timed = _timed(trials, "timing", configurations)
    findings = [_finding(setup, toggles[name], outcomes, timed, proven) for name in toggles]
    search = SmallestSetSearch(trials, outcomes[BASE])
    free = search.smallest(proven, _worthwhile(findings))
    needed = [each.effect for each in findings if each.need == "needed"]
    free, interactions = search.interactions(free, needed)
    saving = _timed(trials, "saving", [BASE, free]) if free else {}
    report = EffectsReport(
        scene=setup.scene.name,
        scene_hash=setup.scene.hash,
        source=request.source,
        base=_written(setup.base),
        scenarios=tuple(_written(each) for each in setup.scenarios),
        seeds=setup.seeds,
        duration=setup.duration or setup.scene.duration,
        tolerances=dict(setup.tolerances),
        engine=engine(),
        provenance=provenance(),
        effects=tuple(findings),
        interactions=interactions,
        smallest_set=_set(toggles, free, proven),
        saving=cost_ratio(saving[BASE], saving[free]) if free else None,
        verification=_verified(trials, free),
        stores=tuple(trials.stores),
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _singles(toggles: Mapping[str, Toggle]) -> dict[str, Changed]:
    return {name: (name,) for name, each in toggles.items() if each.proof is None}


def _proven(toggles: Mapping[str, Toggle]) -> Changed:
    return merged([name for name, each in toggles.items() if each.proof is not None])


def _timed(
    trials: ConfigurationRunner,
    name: str,
    configurations: Sequence[Changed],
    seeds: Sequence[int] | None = None,
) -> dict[Changed, ConfigurationRows]:
    """Time configurations, interleaved, in at most six matched pairs of each with the base."""
    if trials.rounds is None:
        return dict.fromkeys(configurations, ConfigurationRows(()))
    setup = trials.setup
    scenarios = setup.scenarios[:: max(1, len(setup.scenarios) // _PAIRS)][:_PAIRS]
    seeds = (setup.seeds if seeds is None else seeds)[: max(1, _PAIRS // len(scenarios))]
    about = "Configurations timed in turns"
    return trials.run(name, about, configurations, seeds=seeds, scenarios=scenarios, timed=True)


def _finding(
    setup: AblationSetup,
    toggle: Toggle,
    outcomes: Mapping[Changed, ConfigurationRows],
    timed: Mapping[Changed, ConfigurationRows],
    proven: Changed,
) -> EffectFinding:
    """Return what is found of one effect; those that are unused by proof were changed at once."""
    changed = proven if toggle.proof is not None else (toggle.effect,)
    exempt = exempted(changed, setup.tolerances)
    found = difference(setup, setup.scenarios, outcomes[BASE], outcomes[changed], exempt)
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


def _need(toggle: Toggle, found: ConfigurationDifference, cost: Ratio | None) -> Need:
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
        mjcf=settings_mjcf(settings),
        sweep=settings_sweep(settings, proven),
    )


def _verified(trials: ConfigurationRunner, free: Changed) -> Verification:
    """Run the smallest set and the base configuration from fresh seeds, in fresh scenarios."""
    setup = trials.setup
    first = max(setup.seeds) + 1
    seeds, scenarios = tuple(range(first, first + FRESH_SEEDS)), setup.fresh_scenarios
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
    exempt = exempted(free, setup.tolerances)
    found = difference(setup, scenarios, outcomes[BASE], outcomes[free], exempt)
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
