"""The influence and the cost of each feature and part of a model, and the model without the rest.

Each is left out alone from the model as written, in windows along the motion of that model: in the
task, with gravity tilted, and with twice the controls and pushes. Those that cost most come first.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import mujoco

from contactlab.budget import Motion
from contactlab.budget.counted_time import count_pace
from contactlab.budget.restarts import build_reference_model
from contactlab.errors import SceneError, SweepFileError
from contactlab.modifications.unused_pairs import own_sensors, unused_flags, with_flags
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_names import name_of
from contactlab.scene.model_writer import refuse_place
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.effects_report import REPORT, EffectsReport, PartEffect
from contactlab.schema.time_ratio import LEAST_SAVING, TimeRatio
from contactlab.step_progress import count_steps, step_names
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.studies.effects.examined_scenarios import Scenarios, open_scenarios
from contactlab.studies.effects.model_parts import (
    ComparisonLimits,
    ModelPart,
    change_model,
    find_parts,
)
from contactlab.studies.effects.part_errors import MeasuredPart, PartErrors
from contactlab.studies.effects.smaller_model import SmallerSearch, describe_result
from contactlab.studies.verification.grip_measures import needs_masks
from contactlab.studies.verification.panel import OriginalRuns
from contactlab.tasks.compiled_changes import compile_changed
from contactlab.tasks.reference_error import TaskReference
from contactlab.tasks.session import Session
from contactlab.tasks.stress_motions import (
    TILT_DEGREES,
    KnownStates,
    double_inputs,
    tilt_gravity,
)
from contactlab.tasks.task_clock import Clock
from contactlab.tasks.time_limit import TimeLimit
from contactlab.timing.interleaved import TimingProtocol

_CLOSE = TimingProtocol(half_width=LEAST_SAVING / 3)
"""Rounds of parts that may go, if there is time: they resolve a third of the least saving."""
_SCREENING = TimingProtocol(rounds=6, looks=1)
"""The same of slow models; whole runs time the model without all of them more closely."""


def study_effects(request: EffectsRequest, session: Session) -> EffectsReport:
    """Leave out one part after the other, write the smaller model and the report.

    Raises:
        SceneError: there is no such model, it does not compile, or it has no part to keep by a
            name.
        SweepFileError: the sweep or a setting is wrong, or the tolerance is not a share.
        EngineError: nothing moves, or another engine is requested.
        OutputError: the folder cannot be written, or has another model's results.
    """
    begin, allowed = time.monotonic(), TimeLimit(request.max_cpu)
    if request.task.limits:
        name = next(iter(request.task.limits))
        raise SweepFileError(f"--tolerance {name}=: write a share of the real forces, as 5%")
    scenarios = open_scenarios(request, session)
    examined = scenarios.models[0]
    if request.write is not None:
        refuse_place(examined.scene.source, request.write.parent, request.write.name)
    session.claim("effects", request.source)
    session.notify(f"leaving out parts of {request.source}: {examined.task.line}")
    steps = (
        "running the reference",
        "leaving out parts that save time",
        "verifying the smaller model",
        "leaving out other parts",
    )
    with step_names(len(steps)) as begin_step:
        begin_step(steps[0])
        study = EffectsStudy(request, scenarios, allowed)
        begin_step(steps[1])
        study.measure_savings()
        begin_step(steps[2])
        smaller_share = 0.8  # of the time limit; the rest shows which other parts are needed
        search = SmallerSearch(
            scenarios=scenarios,
            session=session,
            clock=study.clock,
            errors=study.errors,
            base=study.base,
            runs=study.runs,
            time_limit=replace(allowed, seconds=smaller_share * allowed.seconds),
            write=request.write,
        )
        tolerance = examined.task.tolerance
        smaller = search.find_smaller([one for one in study.measured if one.can_go(tolerance)])
        begin_step(steps[3])
        study.measure_others()
    ranked_parts = sorted(study.measured, key=lambda one: _rank_part(one, tolerance))
    effects = tuple(_describe_part(one, tolerance) for one in ranked_parts)
    report = EffectsReport(
        model=request.source,
        scene_hash=examined.scene.hash,
        mujoco=VERSION,
        task=examined.task,
        scenarios=len(scenarios.models),
        tilt=TILT_DEGREES,
        tolerance=tolerance,
        effects=effects,
        noise_floor=study.noise_floor,
        smaller=smaller,
        kept=search.needed_parts,
        sentence=describe_result(smaller, search),
        timed_out=any(one.late for one in study.measured) or search.is_late,
        seconds=time.monotonic() - begin,
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


class EffectsStudy:
    """The measurement of the parts of one model.

    Attributes:
        scenarios: of the model.
        base: the model as written, compiled from its files.
        errors: of models without parts.
        clock: that times models without parts.
        runs: of the model as written, for its verification.
        measured: the parts.
        noise_floor: time of the model as written over its own.
    """

    def __init__(self, request: EffectsRequest, scenarios: Scenarios, allowed: TimeLimit) -> None:
        """Run the reference, and find the parts."""
        self.scenarios = scenarios
        examined = scenarios.models[0]
        timing_share = 0.05  # of the time limit, that close rounds may take
        self._timing_seconds = timing_share * request.max_cpu
        self._examined, self._allowed = examined, allowed
        self.runs = OriginalRuns()
        self.base = with_flags(
            compile_changed(examined, ModelEdits()), unused_flags(examined.scene.source.model)
        )
        motions, stride = _plan_work(scenarios.motions, request.max_cpu)
        loaded_motions = [*motions, *map(tilt_gravity, motions), *map(double_inputs, motions)]
        reference = TaskReference.run_references(loaded_motions, 1, examined.threads, stride)
        reference = reference.complete_phases()
        same = reference.velocities_around(build_reference_model)
        self.errors = PartErrors(reference, same, motions, examined.threads)
        self.clock = Clock(reference, self.base)
        states = KnownStates(loaded_motions, examined.threads)
        positions = [*(part.positions for part in reference.phases), *states.list_positions()]
        comparing_share = 0.35  # of the time limit, until parts that change no bit are found
        # Distances of a configuration take as long as a few steps.
        seconds = sum(map(len, positions)) * count_pace(motions)
        parts = find_parts(
            examined,
            self.base,
            states,
            positions,
            request.keep,
            with_masks=not needs_masks(examined, self.runs.grips),
            far=request.far_distance,
            limits=ComparisonLimits(
                offers_far=seconds < 0.01 * request.max_cpu,  # as long as one part may take
                is_late=lambda: allowed.elapsed > comparing_share * allowed.seconds,
            ),
        )
        keep = request.keep
        model = self.base
        sizes = {"body": model.nbody, "geom": model.ngeom, "tendon": model.ntendon}
        objects = {name_of(model, kind, row) for kind, size in sizes.items() for row in range(size)}
        part_names = {name for part in parts for name in (part.name, *part.members)}
        known_names = {*objects, *own_sensors(model), "sensors", *part_names}
        for name in keep:
            SceneError.unless_known(name, known_names, f"--keep: no feature or part '{name}'")
        self.measured = [MeasuredPart(part) for part in parts]
        self.noise_floor: TimeRatio | None = None

    def measure_savings(self) -> None:
        """Count the work without each part that may go, then measure errors and times.

        Those that save most work come first. If there is no time for all, only they are timed.
        """
        may_go = [
            one
            for one in self.measured
            if one.part.edits is not None
            and (one.part.assumed or not one.part.reason_to_stay)
            and (one.part.assumed or one.part.exercised or one.part.proof)
        ]
        models = [self._compile_without(one.part) for one in may_go]
        removable_models = [
            (one, model) for one, model in zip(may_go, models, strict=True) if model
        ]
        costs = self.clock.count_costs([(model, 1) for _, model in removable_models])
        for (one, _), cost in zip(removable_models, costs, strict=True):
            one.cost = cost
        rounds = 2 * _CLOSE.looks * _CLOSE.rounds
        is_fast = (
            len(removable_models) + 1
        ) * rounds * self.clock.turn_seconds < self._timing_seconds
        saving = [one for one in may_go if is_fast or one.saves_work]
        measuring_share = 0.5  # of the time limit; the rest is for the smaller model
        self._measure_errors(sorted(saving, key=lambda one: one.cost), measuring_share)
        smaller_models = [(one, model) for one, model in removable_models if one in saving]
        changed = [(model, 1) for _, model in smaller_models]
        *ratios, self.noise_floor = self.clock.time_ratios(
            [*changed, (change_model(self.base), 1)], _CLOSE if is_fast else _SCREENING
        )
        for (one, _), ratio in zip(smaller_models, ratios, strict=True):
            one.ratio = ratio

    def measure_others(self) -> None:
        """Measure the errors, then the times, of parts that stay in any case or save nothing."""
        others = [one for one in self.measured if one.part.exercised and one.ratio is None]
        self._measure_errors(others, 1.0)
        with_errors = [one for one in others if one.error is not None]
        if with_errors and self._allowed.remaining > 0:
            models = [(change_model(self.base, one.part.change), 1) for one in with_errors]
            # Parts that stay in any case get few rounds; 3 show a saving of a tenth if the machine
            # is idle, and others get 6.
            ratios = self.clock.time_ratios(models, TimingProtocol(rounds=3, looks=2))
            costs = self.clock.count_costs(models)
            for one, ratio, cost in zip(with_errors, ratios, costs, strict=True):
                one.ratio, one.cost = ratio, cost

    def _measure_errors(self, parts: Sequence[MeasuredPart], share: float) -> None:
        for one in count_steps(parts, "parts", len(parts)):
            if one.verdict_at == "not measured":
                one.late = self._allowed.elapsed > share * self._allowed.seconds
                if not one.late:
                    one.error = self.errors.estimate_error([one.part])

    def _compile_without(self, part: ModelPart) -> mujoco.MjModel | None:
        if not part.recompiles:
            return change_model(self.base, part.change)
        assert part.edits
        try:
            return compile_changed(self._examined, part.edits)
        except SceneError:
            return None


def _plan_work(motions: Sequence[Motion], max_cpu: float) -> tuple[list[Motion], int]:
    # As many seeds as the counted time of one core allows, then fewer windows. Whole runs show
    # all motion; they are made ten to thirty times, and have no fewer steps for that.
    steps = 3 * sum(motion.steps for motion in motions)  # unchanged, tilted, doubled
    seconds = steps * count_pace(motions)
    pass_share = 0.01  # of the time limit, for one part on average; models have 20 to 50 parts
    most_stride = 8  # at least one in this many windows is used
    allowed = pass_share * max_cpu
    most = min(motion.seeds for motion in motions)
    seeds = min(most, max(1, int(2 * allowed / seconds)))
    stride = min(most_stride, max(1, math.ceil(seeds * seconds / allowed)))
    fewer = [
        replace(motion, starts=motion.starts[:seeds], inputs=motion.inputs[:seeds])
        for motion in motions
    ]
    return fewer, stride


def _rank_part(one: MeasuredPart, tolerance: float) -> tuple[bool, float]:
    # Rows have the order of the time ratios that they show. Counted work chooses the timed rows.
    saving = one.cost if one.ratio is None else one.ratio.ratio
    if one.ratio is not None and one.ratio.low <= 1 <= one.ratio.high:
        saving = 1.0  # the difference is noise
    return one.find_verdict(tolerance) in ("not exercised", "not measured"), saving


def _describe_part(one: MeasuredPart, tolerance: float) -> PartEffect:
    part, estimate = one.part, one.error
    return PartEffect(
        kind=part.kind,
        name=part.name,
        adds=part.adds,
        members=part.members,
        verdict=one.find_verdict(tolerance),
        error=estimate.error if estimate else None,
        body=estimate.body if estimate else "",
        phase=estimate.phase if estimate else "",
        time=estimate.time if estimate else None,
        time_ratio=one.ratio,
        reason=part.proof or part.reason_to_stay or part.assumed,
        can_go=one.can_go(tolerance),
    )
