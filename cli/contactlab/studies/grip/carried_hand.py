"""A robot's grip as a fact of its examination: of what a keyframe holds, or of its hand."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import mujoco

from contactlab.errors import SceneError
from contactlab.schema.examination import Fact
from contactlab.schema.grip import GripReport
from contactlab.schema.task import QPOS0
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.gripping import GripRequest, run
from contactlab.studies.grip.remedies import Grip

# What closes is a hand if it weighs at most this share of the robot that moves it: legs, which
# would close on a box as well, weigh more.
_HAND = 0.2


def grip_facts(reference: str, model: mujoco.MjModel, start: str) -> tuple[Fact, ...]:
    """Return whether what the start holds, or else the robot's hand, holds an object; if any.

    Of what is fixed to the world and closes, it is told only if the object stays: legs drop it.
    """
    for request in _requests(reference, start):
        try:
            carried = request.keyframe is not None or _is_carried(model)
            if not carried and not _is_fixed(model):
                continue
            report = run(request)
        except SceneError:
            continue  # nothing is held there, or there is no hand
        return (_fact(report),) if carried or report.verdict != "drops" else ()
    return ()


def film_grip(reference: str, start: str, film: Callable[[Grip], None]) -> None:
    """Film the grip that `grip_facts` tells of.

    Raises:
        SceneError: there is none.
    """
    for request in _requests(reference, start):
        try:
            run(replace(request, film=film))
        except SceneError:
            continue
        return
    raise SceneError(f"{reference} grips nothing")


def _requests(reference: str, start: str) -> Iterator[GripRequest]:
    """Yield the grips to judge, the first of which that there is counts."""
    bench = GripRequest(reference, remedies=False, placements=False)
    if start != QPOS0:
        yield replace(bench, keyframe=start)
    yield bench


def _is_carried(model: mujoco.MjModel) -> bool:
    """Return whether a hand is a small part of the robot that carries it."""
    base = find_hand(model).base
    robot = int(model.body_rootid[base])
    return bool(model.body_subtreemass[base] <= _HAND * model.body_subtreemass[robot])


def _is_fixed(model: mujoco.MjModel) -> bool:
    """Return whether the robot of a hand is joined to the world without a joint."""
    return bool(model.body_weldid[model.body_rootid[find_hand(model).base]] == 0)


def _fact(report: GripReport) -> Fact:
    speeds = [math.inf if drift.speed is None else drift.speed for drift in report.drifts]
    worst = max(speeds, default=math.inf)
    lost = math.isinf(worst)
    first = min((drift.lost for drift in report.drifts if drift.lost is not None), default=0.0)
    where = f"keyframe {report.keyframe}" if report.keyframe else "its hand"
    return Fact(
        kind="grip",
        place=report.base,
        value=first if lost else worst,
        unit="s" if lost else "m/s",
        sentence=f"{where} ({report.base}) {report.sentence} (contactlab grip)",
    )
