"""Compares how both models grip: the speed of creep, the force that is held, and the depth."""

import math
from collections.abc import Iterator

from contactlab.errors import SceneError
from contactlab.modifications.model_predicates import lacks_surroundings
from contactlab.schema.grip import GripReport
from contactlab.schema.verification import VerifiedMeasure
from contactlab.studies.grip.grip_fact import grip_requests
from contactlab.studies.grip.grip_verdict import MOST_DEPTH
from contactlab.studies.grip.gripping import GripRequest, judge_grip
from contactlab.tasks.checked_model import CheckedModel

_RELATIVE = 0.05  # friction is not known better, and neither is a force that it holds
_LOST = 1.0  # m/s, which stands for an object that is lost: faster than any creep


def compare_grips(
    original: CheckedModel,
    changed: CheckedModel,
    known_reports: dict[str | None, GripReport | None],
) -> Iterator[VerifiedMeasure]:
    """Yield the measures of each grip that holds an object, or lets it creep, in the original.

    An object that the original drops has nothing to lose. If the changed model cannot be closed on
    the object at all, it counts as dropped. `known_reports` has the original's reports by keyframe;
    missing ones are added.
    """
    for before in judge_original_grips(original, known_reports):
        request = GripRequest(
            changed.reference, keyframe=before.keyframe, fixes=False, placements=False
        )
        yield from _compare_reports(before, _judge_possible_grip(request))


def judge_original_grips(
    original: CheckedModel, known_reports: dict[str | None, GripReport | None]
) -> Iterator[GripReport]:
    """Yield the original's grips that hold an object or let it creep; `known_reports` as above."""
    model, start = original.motions[0].model, original.task.start
    for request in grip_requests(original.reference, model, start):
        quiet = GripRequest(request.model, keyframe=request.keyframe, fixes=False, placements=False)
        if request.keyframe not in known_reports:
            known_reports[request.keyframe] = _judge_possible_grip(quiet)
        report = known_reports[request.keyframe]
        if report is not None and report.verdict != "drops":
            yield report


def needs_masks(original: CheckedModel, known_reports: dict[str | None, GripReport | None]) -> bool:
    """Return whether geoms that touch nothing in a file touch objects of other files.

    So do the pads of a gripper, and the feet of a walker without a floor. `known_reports` as above.
    """
    if lacks_surroundings(original.motions[0].model):
        return True
    return any(report.keyframe is None for report in judge_original_grips(original, known_reports))


def _judge_possible_grip(request: GripRequest) -> GripReport | None:
    try:
        return judge_grip(request)
    except SceneError:
        return None


def _compare_reports(before: GripReport, after: GripReport | None) -> Iterator[VerifiedMeasure]:
    run = f"grip of keyframe {before.keyframe}" if before.keyframe else "grip of its hand"
    creep, other = _creep_of(before), _LOST if after is None else _creep_of(after)
    least_creep = 1e-5  # m/s: a tenth of a millimeter in the ten seconds of a pick and place
    tolerance = max(least_creep, _RELATIVE * creep)
    # Fingers inside an object do not hold it by friction, so its creep is not that of a grip.
    is_inside = before.depth_share > MOST_DEPTH
    if not is_inside:
        yield VerifiedMeasure(
            name="grip creep",
            run=run,
            unit="m/s",
            before=creep,
            after=other,
            spread=0.0,
            tolerance=tolerance,
            place=before.base,
            worse=other > creep + tolerance,
        )
    force, pull_after = before.pull.force, 0.0 if after is None else after.pull.force
    least = (1 - _RELATIVE) * force
    if is_inside:
        least = min(least, before.weight)
    yield VerifiedMeasure(
        name="pull-out force",
        run=run,
        unit="N",
        before=force,
        after=pull_after,
        spread=0.0,
        tolerance=force - least,
        place=before.pull.direction,
        more_is_better=True,
        worse=pull_after < least,
    )
    if after is None:
        return
    least_depth = 0.01  # of half of the object's width
    tolerance = max(_RELATIVE * before.depth_share, least_depth)
    yield VerifiedMeasure(
        name="grip depth",
        run=run,
        unit="1",
        before=before.depth_share,
        after=after.depth_share,
        spread=0.0,
        tolerance=tolerance,
        place=before.base,
        worse=after.depth_share > before.depth_share + tolerance,
    )


def _creep_of(report: GripReport) -> float:
    speeds = [_LOST if drift.speed is None else drift.speed for drift in report.drifts]
    return min(_LOST, max(speeds, default=math.inf))
