"""Ablation: the effects that a scene needs, the time of each, and the smallest sufficient set."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path

from contactlab.errors import EngineError, SceneError
from contactlab.modifications.catalogue import find_safeguards
from contactlab.run.evidence_record import find_engine, find_provenance
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.schema.coverage import Exercised
from contactlab.schema.evidence import Setting
from contactlab.schema.study_reports import (
    EffectFinding,
    EffectVerdict,
    Interaction,
    RecordedEffectsReport,
    SmallestSet,
    Verification,
)
from contactlab.schema.time_ratio import LEAST_SAVING, TimeRatio
from contactlab.schema.tradeoff_report import REALITY
from contactlab.schema.verification import VerifiedChange
from contactlab.store.table_layout import axis_cell
from contactlab.studies.effects.configuration_runs import ConfigurationRows
from contactlab.studies.effects.effect_toggles import (
    BASE,
    Changed,
    ConfigurationDifference,
    ConfigurationRunner,
    Toggle,
    cost_ratio,
    difference,
    find_toggles,
    settings_sweep,
    work_ratios,
)
from contactlab.studies.effects.effects_request import AblationSetup, EffectsRequest
from contactlab.studies.verification import VerificationRequest, verify_change
from contactlab.studies.verification.panel import OriginalRuns
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.session import Session, Values


@dataclass
class SmallestSetSearch:
    """Searches for the smallest set of effects."""

    trials: ConfigurationRunner
    base: ConfigurationRows
    tried: int = 0

    def find_smallest(self, certain: Sequence[str], likely: Sequence[str]) -> Changed:
        """Return a large set of toggles that changes no result, found greedily.

        Certain toggles change nothing by proof, likely ones change nothing alone; the most
        worthwhile of these comes first.
        """
        everything = merge_names(certain, likely)
        if not everything or self._is_below_tolerance(everything):
            return everything
        free = (
            merge_names(certain)
            if certain and self._is_below_tolerance(merge_names(certain))
            else BASE
        )
        rest = [name for name in (*certain, *likely) if name not in free]
        # Each step is compared with the base configuration, not with the previous step, so that
        # small changes cannot add up.
        for name in rest:
            if self._is_below_tolerance(merge_names(free, [name])):
                free = merge_names(free, [name])
        return free

    def find_interactions(
        self, free: Changed, needed: Sequence[str]
    ) -> tuple[Changed, tuple[Interaction, ...]]:
        """Toggle pairs of effects that are needed alone; return the removable set, and all pairs.

        Each pair is run with one seed first; those that pass are run with all seeds.
        """
        pairs, setup = list(combinations(needed, 2)), self.trials.setup
        if not pairs:
            return free, ()
        each_changed = [merge_names(free, pair) for pair in pairs]
        outcomes = self._run([BASE, *each_changed], replace(setup, seeds=setup.seeds[:1]))
        interactions: list[Interaction] = []
        for pair, changed in zip(pairs, each_changed, strict=True):
            change = difference(setup.tolerances, outcomes[BASE], outcomes[changed], changed)
            passed = not change.is_significant and self._is_below_tolerance(merge_names(free, pair))
            free = merge_names(free, pair) if passed else free
            interactions.append(
                Interaction(effects=pair, below_tolerance=passed, reason=change.reason)
            )
        return free, tuple(interactions)

    def _is_below_tolerance(self, changed: Changed) -> bool:
        outcome = self._run([changed])[changed]
        return not difference(
            self.trials.setup.tolerances, self.base, outcome, changed
        ).is_significant

    def _run(
        self, configurations: Sequence[Changed], setup: AblationSetup | None = None
    ) -> Mapping[Changed, ConfigurationRows]:
        self.tried += 1
        name = f"search-{self.tried:02}"
        return self.trials.run(name, "Effects changed together", configurations, setup)


def merge_names(*names: Collection[str]) -> Changed:
    """Return the union of toggled effects."""
    return tuple(sorted({name for group in names for name in group}))


REPORT = "recorded-effects.json"
FRESH_SEEDS = 10


def find_smallest_set(request: EffectsRequest, session: Session) -> RecordedEffectsReport:
    """Change one effect at a time, search for the smallest set, and verify it.

    The report is written to `effects.json` next to the stores. Raises a SweepFileError if the sweep
    or a setting is wrong (all are named); a SceneError if there is no such scene, or it does not
    compile; an OutputError if the session's folder cannot be written; a StoppedError if the session
    was stopped.
    """
    setup = request.setup
    session.claim("recorded-effects", request.source)
    toggles = {toggle.effect: toggle for toggle in find_toggles(setup)}
    trials = ConfigurationRunner(setup, toggles, session, request.rounds)
    proven = merge_names(
        [name for name, toggle in toggles.items() if toggle.proof and name not in find_safeguards()]
    )
    singles = [(name,) for name, toggle in toggles.items() if toggle.proof is None]
    configurations = [BASE, *singles, *([proven] if proven else [])]
    outcomes = trials.run("one-by-one", "One effect changed at a time", configurations)
    timed = trials.timed("timing", configurations)
    exercised = Exercised.of_rows(outcomes[BASE].flat)
    findings = [
        _finding_of(setup.tolerances, toggle, outcomes, timed, proven, exercised)
        for toggle in toggles.values()
    ]
    search = SmallestSetSearch(trials, outcomes[BASE])
    ranked = _rank_worthwhile(findings, setup)
    free = search.find_smallest(proven, ranked)
    needed = [finding.effect for finding in findings if finding.verdict == "needed"]
    free, interactions = search.find_interactions(free, needed)
    chosen = _keep_loaded_effects(trials, toggles, free, ranked)
    free = chosen.free
    saving = trials.timed("saving", [BASE, free]) if free else {}
    report = RecordedEffectsReport(
        scene=setup.scene.name,
        scene_hash=setup.scene.hash,
        source=request.source,
        task=setup.task,
        base=_as_written(setup.base),
        scenarios=tuple(_as_written(scenario) for scenario in setup.scenarios),
        seeds=setup.seeds,
        duration=setup.duration or setup.scene.duration,
        tolerances=dict(setup.tolerances),
        engine=find_engine(),
        provenance=find_provenance(),
        effects=tuple(findings),
        interactions=interactions,
        smallest_set=_smallest_set(toggles, chosen, proven),
        time_ratio=cost_ratio(saving[BASE], saving[free]) if free else None,
        verification=_verify_set(trials, chosen),
        stores=tuple(trials.stores),
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _finding_of(
    tolerances: Mapping[str, float],
    toggle: Toggle,
    outcomes: Mapping[Changed, ConfigurationRows],
    timed: Mapping[Changed, ConfigurationRows],
    proven: Changed,
    exercised: Exercised,
) -> EffectFinding:
    """Return the finding of one effect; effects that are unused by proof are toggled together.

    An effect that no run exercised is "not exercised" instead of "below the tolerance".
    """
    changed = proven if toggle.proof is not None else (toggle.effect,)
    pair = outcomes[BASE], outcomes[changed]
    matters = "if unsure" if toggle.on else "if closer"
    change = difference(tolerances, *pair, changed, matters=matters)
    ratio = None if toggle.proof else cost_ratio(timed[BASE], timed[changed])
    effect, verdict = EFFECTS[toggle.effect], _verdict_of(toggle, change, ratio)
    lack = (
        exercised.describe_lacking([effect.feature])
        if effect.feature and verdict == "below the tolerance"
        else None
    )
    return EffectFinding(
        effect=toggle.effect,
        kind=effect.kind,
        summary=effect.what,
        on=toggle.on,
        verdict="not exercised" if lack else verdict,
        reason=lack or toggle.proof or change.reason,
        settings=_as_written(toggle.values),
        metric_changes=change.metric_changes,
        within_spread=change.within_spread,
        labels=dict(change.labels),
        time_ratio=ratio,
        work_ratios={} if toggle.proof else work_ratios(timed[BASE], timed[changed]),
    )


def _verdict_of(
    toggle: Toggle, change: ConfigurationDifference, ratio: TimeRatio | None
) -> EffectVerdict:
    if toggle.on:
        if change.is_significant:
            return "needed"
        return "below the tolerance" if toggle.proof is None else "unused"
    if change.is_significant:
        return "missing"
    faster = ratio is not None and ratio.is_less(by=LEAST_SAVING)
    return "saves time" if faster else "no effect"


def _rank_worthwhile(findings: Sequence[EffectFinding], setup: AblationSetup) -> list[str]:
    """Return the effects worth toggling, the most worthwhile first.

    Missing effects are worth it if recordings decide. Numerical effects stay unless toggling them
    saves time: most of them exist to save time, or guard against settings that this scene does not
    have.
    """
    faster = {
        finding.effect
        for finding in findings
        if finding.time_ratio is not None and finding.time_ratio.is_less()
    }
    worthwhile = [
        finding
        for finding in findings
        if finding.effect not in find_safeguards()
        and (
            finding.verdict == "saves time"
            or (finding.verdict == "missing" and {*setup.tolerances} == {REALITY})
            or (
                finding.verdict == "below the tolerance"
                and (finding.kind != "numerical" or finding.effect in faster)
            )
        )
    ]
    ranked = sorted(
        worthwhile, key=lambda effect: 1.0 if effect.time_ratio is None else effect.time_ratio.ratio
    )
    return [finding.effect for finding in ranked]


@dataclass(frozen=True)
class ChosenSet:
    """The effects that go together.

    Attributes:
        free: the changed effects.
        settings: their settings.
        written: the model with them, or the reason why its files cannot have them.
        panel: the written model compared with the base under other loads, if that was possible.
        kept: effects that stay, with the measure that was worse without them.
    """

    free: Changed
    settings: Values
    written: WrittenModel | SceneError
    panel: VerifiedChange | None
    kept: Mapping[str, str]


def _keep_loaded_effects(
    trials: ConfigurationRunner, toggles: Mapping[str, Toggle], free: Changed, ranked: Sequence[str]
) -> ChosenSet:
    # Effects go back, those that save least first, until no measure of another load is worse.
    setup, session = trials.setup, trials.session
    returnable = [name for name in ranked if name in free]
    kept, runs = dict[str, str](), OriginalRuns()
    while True:
        settings = {axis: value for name in free for axis, value in toggles[name].values.items()}
        written = _write_set(setup, settings, session.folder / "written-model")
        panel = None
        if isinstance(written, WrittenModel) and free and {*setup.tolerances} != {REALITY}:
            text = setup.written(written.reference, {**settings, **dict.fromkeys(free)})
            panel = _compare_loads(setup, text, session, runs)
        if panel is None or panel.passed or not returnable:
            return ChosenSet(free, settings, written, panel, kept)
        name = returnable.pop()
        kept[name] = panel.sentence
        free = tuple(other for other in free if other != name)


def _write_set(setup: AblationSetup, settings: Values, folder: Path) -> WrittenModel | SceneError:
    """Write the model with settings; return the error if its files cannot have them."""
    try:
        return write_model(setup.scene, ModelEdits(settings), folder)
    except SceneError as error:
        return error


def _smallest_set(toggles: Mapping[str, Toggle], chosen: ChosenSet, proven: Changed) -> SmallestSet:
    free, settings, written = chosen.free, chosen.settings, chosen.written
    made = [name for name in free if toggles[name].values.items() <= settings.items()]
    present = [name for name, toggle in toggles.items() if toggle.on]
    return SmallestSet(
        on=tuple(sorted({*present} ^ {*made})),
        off=tuple(name for name in made if toggles[name].on),
        added=tuple(name for name in made if not toggles[name].on),
        kept=dict(chosen.kept),
        settings=_as_written(settings),
        mjcf=written.lines if isinstance(written, WrittenModel) else (),
        no_patch_reason=str(written) if isinstance(written, SceneError) else None,
        sweep=settings_sweep(settings, proven),
    )


def _verify_set(trials: ConfigurationRunner, chosen: ChosenSet) -> Verification:
    """Run the smallest set and the base configuration with fresh seeds, in fresh scenarios.

    The set is run as settings and, if it could be written, as the written model.
    """
    setup, free, settings, written = trials.setup, chosen.free, chosen.settings, chosen.written
    first = max(setup.seeds) + 1
    seeds, scenarios = tuple(range(first, first + FRESH_SEEDS)), setup.fresh_scenarios
    fresh = replace(setup, seeds=seeds, scenarios=scenarios)
    if not free:
        why = "nothing can be left out"
        return Verification(
            seeds=seeds, scenarios=(), runs=0, holds=True, reason=why, time_ratio=None
        )
    about = "The smallest set against the base configuration, from fresh seeds"
    outcomes = trials.run("fresh", about, [BASE, free], fresh)
    farther = partial(difference, setup.tolerances, outcomes[BASE], matters="if farther")
    change = farther(outcomes[free], free)
    timed = trials.timed("fresh-timing", [BASE, free], seeds)
    pasted = None
    if isinstance(written, WrittenModel):
        as_text = fresh.written(written.reference, {**settings, **dict.fromkeys(free)})
        text = "The model with the smallest set in its files"
        rows = trials.run("written", text, [BASE], as_text)
        pasted = farther(rows[BASE], free)
    failed = next(
        (comparison for comparison in (change, pasted) if comparison and comparison.is_significant),
        None,
    )
    panel = chosen.panel
    harm = panel is not None and not panel.passed
    reason = f"as text, {failed.reason}" if failed and failed is pasted else change.reason
    return Verification(
        seeds=seeds,
        scenarios=tuple(_as_written(scenario) for scenario in scenarios),
        runs=len(outcomes[free].flat),
        holds_as_written=pasted and not pasted.is_significant,
        holds=failed is None and not harm,
        reason=f"worse than the base: {panel.sentence}"
        if panel and harm and not failed
        else reason,
        measures=panel,
        time_ratio=cost_ratio(timed[BASE], timed[free]),
    )


def _compare_loads(
    setup: AblationSetup, written: AblationSetup, session: Session, runs: OriginalRuns
) -> VerifiedChange | None:
    """Compare a written model with the base where runs of its task do not load it.

    None if MuJoCo does not simulate it, or nothing in it moves.
    """

    def check(own: AblationSetup) -> CheckedModel:
        return CheckedModel(
            reference=own.reference,
            scenes=own.scenes,
            session=replace(session, workers=0),
            values={**own.base, **own.scenarios[0]},
            duration=own.duration,
            options=own.options,
            thresholds=own.thresholds,
            threads=max(1, session.workers),
        )

    original, changed = check(setup), check(written)
    request = VerificationRequest(
        original=original,
        changed=changed,
        same_model=False,
        allowed_error=original.task.tolerance,
        stop_early=True,
        with_labels=False,
        runs=runs,
    )
    try:
        return verify_change(request)
    except EngineError:
        return None


def _as_written(values: Values) -> dict[str, Setting]:
    return {name: axis_cell(value) for name, value in values.items()}
