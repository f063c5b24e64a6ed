"""Features that recordings need: the mean distance of runs from recorded runs, with and without.

A feature that the model lacks is missing if runs are surely closer to their recordings with it. One
that the model has is needed unless runs are surely not farther away without it.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean, stdev

from contactlab.budget.restarts import build_reference_model
from contactlab.errors import SceneError
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.effects_report import (
    FOLDER,
    REPORT,
    EffectsReport,
    PartEffect,
    PartVerdict,
    SmallerModel,
)
from contactlab.schema.tradeoff_report import REALITY
from contactlab.studies.effects.configuration_runs import run_configurations
from contactlab.studies.effects.effects_request import EffectsRequest, SweepSetup, read_setup
from contactlab.studies.effects.examined_scenarios import Scenarios, check_scenario
from contactlab.studies.effects.model_parts import (
    ModelPart,
    change_model,
    list_missing_features,
    list_model_features,
)
from contactlab.tasks.compiled_changes import compile_changed
from contactlab.tasks.reference_error import TaskReference
from contactlab.tasks.session import Session
from contactlab.tasks.task_clock import Clock

_RELEVANT = 0.05
"""Smallest relevant change of the mean distance from recordings, as a share of it."""
_SEARCH, _FRESH = "one-by-one", "fresh"
"""Stores of the runs: each feature alone, and the chosen features on other recorded runs."""
Distances = Sequence[float | None]


@dataclass(frozen=True)
class DistanceChange:
    """The change of the mean distance from recordings.

    Attributes:
        change: of the mean.
        spread: half of its interval; infinite for a single run.
        limit: smallest relevant change.
        mean: distance of the model as written.
        ends_early: whether a run no longer reaches the end of its recording.
    """

    change: float
    spread: float
    limit: float
    mean: float
    ends_early: bool

    @property
    def is_closer(self) -> bool:
        """Whether runs are surely closer."""
        return not self.ends_early and -self.change > max(self.limit, self.spread)

    @property
    def is_farther(self) -> bool:
        """Whether runs are surely farther away."""
        return self.ends_early or self.change > max(self.limit, self.spread)

    @property
    def is_kept(self) -> bool:
        """Whether runs are surely not farther away."""
        return not self.ends_early and self.change + self.spread <= self.limit

    @property
    def share(self) -> float:
        """The change as a share of the distance of the model as written."""
        return abs(self.change) / self.mean if self.mean else abs(self.change)


def compare_distances(base: Distances, other: Distances, tolerance: float = 0.0) -> DistanceChange:
    """Compare the distances of matched runs; None is a run that ends early.

    A tolerance of 0 stands for 5 % of the mean distance.
    """
    own = [distance for distance in base if distance is not None]
    changes = [
        after - before
        for before, after in zip(base, other, strict=True)
        if before is not None and after is not None
    ]
    mean = fmean(own) if own else 0.0
    spread = float("inf")
    if len(changes) > 1:
        standard_errors = 3.0  # over recorded runs, in half of the interval of a change
        spread = standard_errors * stdev(changes) / len(changes) ** 0.5
    return DistanceChange(
        change=fmean(changes) if changes else 0.0,
        spread=spread,
        limit=tolerance or _RELEVANT * mean,
        mean=mean,
        ends_early=sum(each is None for each in other) > sum(each is None for each in base),
    )


def study_recordings(request: EffectsRequest, session: Session) -> EffectsReport:
    """Change one feature at a time, choose those that recordings call for, and write the model.

    Raises:
        SceneError: there is no such scene, it has no recording, or no feature of a name to keep.
        SweepFileError: the sweep or a setting is wrong.
        OutputError: the folder cannot be written, or has another model's results.
    """
    begin = time.monotonic()
    setup = read_setup(request, recordings=True)
    session.claim("effects", request.source)
    checked = check_scenario(setup, setup.scenarios[0], session)
    model = checked.motions[0].model
    features = [*list_model_features(checked, model), *list_missing_features(checked, model)]
    features = [part for part in features if part.edits and not part.proof]
    own = [part.name for part in features if not part.adds]
    for name in request.keep:
        SceneError.unless_known(name, own, f"--keep: no feature '{name}'")
    features = [
        replace(part, reason_to_stay=part.reason_to_stay or "--keep")
        if part.name in request.keep
        else part
        for part in features
    ]
    base, *others = _measure_distances(session, setup, _SEARCH, [{}, *map(_settings_of, features)])
    tolerance = setup.tolerances.get(REALITY, 0.0)
    changes = [compare_distances(base, other, tolerance) for other in others]
    reference = TaskReference.run_references(checked.motions, 1, checked.threads)
    reference.velocities_around(build_reference_model)
    written_model = compile_changed(checked, ModelEdits())
    clock = Clock(reference, written_model)
    ratios = clock.time_ratios([(change_model(written_model, part.change), 1) for part in features])
    rows = [
        PartEffect(
            kind=part.kind,
            name=part.name,
            adds=part.adds,
            verdict=_find_verdict(part, change),
            error=change.share,
            time_ratio=ratio,
            reason=part.reason_to_stay,
            can_go=change.is_closer
            if part.adds
            else change.is_kept and not part.reason_to_stay and ratio.is_less(),
        )
        for part, change, ratio in zip(features, changes, ratios, strict=True)
    ]
    scenarios = Scenarios([checked], session, setup.options, setup)
    chosen = [part for part, row in zip(features, rows, strict=True) if row.can_go]
    place = session.folder / FOLDER, ""
    if request.write is not None:
        place = request.write.parent, request.write.name
    smaller, sentence = _write_chosen(scenarios, clock, chosen, tolerance, place)
    report = EffectsReport(
        model=request.source,
        scene_hash=checked.scene.hash,
        mujoco=VERSION,
        task=checked.task,
        scenarios=len(setup.scenarios),
        tilt=0.0,
        tolerance=tolerance or _RELEVANT,
        recorded=True,
        effects=tuple(sorted(rows, key=_rank_row)),
        noise_floor=None,
        smaller=smaller,
        kept={},
        sentence=sentence,
        timed_out=False,
        seconds=time.monotonic() - begin,
    )
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _settings_of(part: ModelPart) -> Mapping[str, object]:
    assert part.edits
    return part.edits.settings


def _find_verdict(part: ModelPart, change: DistanceChange) -> PartVerdict:
    if part.adds:
        return "missing" if change.is_closer else "not needed"
    return "below the tolerance" if change.is_kept else "needed"


def _rank_row(row: PartEffect) -> tuple[bool, float]:
    ratio = 1.0 if row.time_ratio is None else row.time_ratio.ratio
    return row.verdict != "missing", ratio


def _measure_distances(
    session: Session, setup: SweepSetup, name: str, values: Sequence[Mapping[str, object]]
) -> list[Distances]:
    # The distance of a recorded run is the mean over its seeds.
    sweep_keys = {
        "description": "Features of a scene, against its recorded runs",
        "tolerances": dict(setup.tolerances),
        "trace": "none",
    }
    configurations = run_configurations(session, setup, name, values, sweep_keys)
    return [
        [_mean_distance(rows) for rows in configuration.rows] for configuration in configurations
    ]


def _mean_distance(rows: Sequence[Mapping[str, object]]) -> float | None:
    distances = [row[REALITY] for row in rows]
    whole = [distance for distance in distances if isinstance(distance, float)]
    return fmean(whole) if len(whole) == len(distances) else None


def _write_chosen(
    scenarios: Scenarios,
    clock: Clock,
    chosen: Sequence[ModelPart],
    tolerance: float,
    place: tuple[Path, str],
) -> tuple[SmallerModel | None, str]:
    setup, session, checked = scenarios.setup, scenarios.session, scenarios.models[0]
    assert setup is not None
    if not chosen:
        return None, "No change: no feature brings runs closer to the recordings, or saves time"
    edits = ModelEdits()
    for part in chosen:
        assert part.edits
        edits = edits.joined_with(part.edits)
    fresh = replace(setup, scenarios=setup.fresh_scenarios)
    base, other = _measure_distances(session, fresh, _FRESH, [{}, dict(edits.settings)])
    change = compare_distances(base, other, tolerance)
    names = ", ".join(f"{'add' if part.adds else 'without'} {part.name}" for part in chosen)
    distance_text = (
        f"{len(base)} other recorded runs: distance {change.mean:.3g} {change.change:+.3g}"
    )
    if change.is_farther:
        return None, f"No change: {names} fails on {distance_text}"
    written_model, own = write_model(checked.scene, edits, *place), session.folder.resolve()
    smaller_model = change_model(
        compile_changed(checked, ModelEdits()), *(part.change for part in chosen)
    )
    (ratio,) = clock.time_ratios([(smaller_model, 1)])
    smaller = SmallerModel(
        left_out=tuple(part.name for part in chosen if not part.adds),
        added=tuple(part.name for part in chosen if part.adds),
        error=change.share,
        time_ratio=ratio,
        file=str(
            written_model.path.relative_to(own)
            if written_model.path.is_relative_to(own)
            else written_model.path
        ),
        lines=written_model.lines,
        verified=None,
        sentence=distance_text,
    )
    return smaller, f"The recordings call for: {names}, at {ratio.text} of the time"
