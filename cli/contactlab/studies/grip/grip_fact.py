"""The grip of a robot as a fact of its examination: in a keyframe, or of its own hand."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import mujoco

from contactlab.errors import SceneError
from contactlab.schema.examination import Fact
from contactlab.schema.grip import GripReport
from contactlab.schema.task import QPOS0
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.grip_fixes import Grip
from contactlab.studies.grip.gripping import GripRequest, judge_grip

_HELD = " (contactlab grip)"


def find_grip(
    reference: str,
    model: mujoco.MjModel,
    start: str,
    film: Callable[[Grip], None] = lambda _: None,
) -> GripReport | None:
    """Judge whether the object held at the start, or otherwise the robot's own hand, stays in grip.

    A robot that is fixed to the world is reported only if the object stays, since legs drop it, and
    one moving part only if it holds, since a lift and a press close like a hand, too. None without
    such a grip. `film` is called with the grip of the report.
    """
    for request in _grip_requests(reference, start):
        grips = list[Grip]()
        try:
            carried = request.keyframe is not None or _is_carried(model)
            if not carried and not _is_fixed_hand(model):
                continue
            report = judge_grip(replace(request, film=grips.append))
            is_sure = carried or (report.verdict != "drops" and len(find_hand(model).fingers) > 1)
        except SceneError:
            continue  # nothing is held, or there is no hand
        if not is_sure and not report.holds:
            return None
        for grip in grips:
            film(grip)
        return report
    return None


def _grip_requests(reference: str, start: str) -> Iterator[GripRequest]:
    """Yield the grips to judge; the first possible one counts."""
    mounted_hand = GripRequest(reference, fixes=False, placements=False)
    if start != QPOS0:
        yield replace(mounted_hand, keyframe=start)
    yield mounted_hand


def _is_carried(model: mujoco.MjModel) -> bool:
    """Return whether the hand is a small part of the robot that carries it."""
    base = find_hand(model).base
    robot = int(model.body_rootid[base])
    # A gripper has at most this share of the robot's mass. Legs would close on a box too, but they
    # weigh more.
    most_share = 0.2
    return bool(model.body_subtreemass[base] <= most_share * model.body_subtreemass[robot])


def _is_fixed_hand(model: mujoco.MjModel) -> bool:
    """Return whether the hand is fixed to the world, and is not one part that closes on it."""
    hand = find_hand(model)
    closes_on_world = len(hand.fingers) == 1 and model.body_weldid[hand.base] == 0
    return bool(model.body_weldid[model.body_rootid[hand.base]] == 0 and not closes_on_world)


def describe_grip(report: GripReport) -> Fact:
    """Return a judged grip as a fact."""
    worst = report.worst_speed
    lost = math.isinf(worst)
    first = min(
        (drift.lost_after for drift in report.drifts if drift.lost_after is not None), default=0.0
    )
    where = f"keyframe {report.keyframe}" if report.keyframe else "its hand"
    option = f" --keyframe {report.keyframe}" if report.keyframe else ""
    more = _HELD if report.holds else f"; contactlab grip{option} tests fixes"
    return Fact(
        kind="grip",
        place=report.base,
        value=first if lost else worst,
        unit="s" if lost else "m/s",
        sentence=f"{where} ({report.base}) {report.sentence}{more}",
    )


def is_held(fact: Fact) -> bool:
    """Return whether a fact is of a grip that holds."""
    return fact.kind == "grip" and fact.sentence.endswith(_HELD)


def grip_requests(reference: str, model: mujoco.MjModel, start: str) -> Iterator[GripRequest]:
    """Yield every grip of a model that an object can be held in: its start's, and its hand's.

    A part that closes like a hand counts only if a robot carries it or it is fixed to the world.
    """
    for request in _grip_requests(reference, start):
        try:
            if request.keyframe is not None or _is_carried(model) or _is_fixed_hand(model):
                yield request
        except SceneError:
            continue  # nothing closes
