"""Whether an outcome depends on the step: runs against their refined and perturbed copies.

Speeds are in rad/s, and in mean body sizes a second for what moves along. Distance alone tells
nothing, since all that tumbles parts from its copies: what counts is what anyone would see.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import REFINEMENT, Floats, SelfChecks, motion_at_rest
from contactlab.measure.context import Context, cached, first_step
from contactlab.measure.entries import (
    Finding,
    Found,
    MeasuredRuns,
    Threshold,
    label,
    limits,
    metric,
)

_SHAKING = Threshold(
    "unresolved_motion",
    1e-3,
    "1",
    "Largest metric unresolved_motion, if the refined copy shakes too, by a sixteenth of it, or "
    "moves less than a third as fast. Servos and velocity loops too stiff for their step reach "
    "3e-3 to 1.5; public robots under noise 0.03, but their refined copies are as fast to 5 %.",
)
_REST_RATIO = Threshold(
    "rest_ratio",
    8.0,
    "1",
    "Largest metric rest_ratio, if the perturbed copy is rather like the run. Public robots under "
    "hold and noise reach 1.5, and 3.3 where a foot is caught or not; servos, rattling boxes and "
    "bounces that gain 20 and more.",
)
_TRAVEL = Threshold(
    "step_travel",
    1.0,
    "1",
    "Mean body sizes that a body may end away from its start where in the refined copy it ends "
    "within a tenth of that. Public robots that fall or walk do so in all copies; a tower that "
    "collapses by its step moves 15, and 0.07 when refined.",
)
_UNRESOLVED = 0.3
"""Change per step over speed, from which a period has fewer than about 21 steps."""
_MOVING = 0.5
"""Least speed of what does not come to rest."""
_NO_SPEED = 1 / 16
"""Speeds below this one are as good as none."""
_LIKE = 3.0
"""Factor within which a run and a copy are as fast."""
_STAYS = 0.1
"""Share of the travel in the run within which a body stays where it was."""
_FEWEST_STEPS = 8
_DEGREES = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}


class _Ends(NamedTuple):
    """How n runs move in their last quarter, and, after a second pass, their copies.

    Arrays are (n, 1, nv) or (n, 3, nv): the runs, their refined and their perturbed copies.

    Attributes:
        speed: root mean square.
        motion: in a step of their own [rad, or mean body sizes].
        shaking: whether it changes from step to step as nothing does that the step resolves.
    """

    speed: Floats
    motion: Floats
    shaking: NDArray[np.bool_]

    @property
    def total(self) -> Floats:
        """(n, 1) or (n, 3) root mean square speed over all degrees of freedom."""
        return np.sqrt((self.speed**2).mean(axis=2))


def _degrees(context: Context) -> tuple[list[str], Floats]:
    """Return the joint of each degree of freedom, and (nv,) what its speeds are divided by."""
    mechanism = context.setup.mechanism
    if mechanism is None:
        return [""] * context.trace.qvel.shape[2], np.ones(1)
    along = {"slide": 1, "free": 3}
    degrees = [(each, place) for each in mechanism.joints for place in range(_DEGREES[each.kind])]
    moves = np.array([place < along.get(each.kind, 0) for each, place in degrees])
    return [each.name for each, _ in degrees], np.where(moves, mechanism.size, 1.0)


@cached
def _ends(context: Context) -> _Ends:
    trace, checks = context.trace, context.checks
    own = [[motion_at_rest(each[1:])] for each in trace.qvel] if checks is None else checks.rest
    speed, change = np.moveaxis(np.array(own) / _degrees(context)[1], 2, 0)
    steps = trace.timestep[:, None] / [1, REFINEMENT, 1]
    return _Ends(speed, speed * steps[:, : len(own[0]), None], change >= _UNRESOLVED * speed)


@metric("1", "lower", 1e-9, kind="detail")
def unresolved_motion(context: Context) -> Floats:
    """Largest motion per step of a degree of freedom that oscillates from step to step at the end.

    Root mean square speed in the last quarter times the timestep, in rad or mean body sizes, of
    those whose velocity changes by 0.3 of that speed in half of the steps.
    """
    ends = _ends(context)
    return (ends.motion * ends.shaking)[:, 0].max(axis=1, initial=0)


@metric("1", "lower", 1e-9, kind="check")
def rest_ratio(context: Context) -> Floats:
    """Speed in the last quarter over that of a copy at a quarter of the step, or its inverse.

    Root mean square over all degrees of freedom, in rad/s and mean body sizes a second, at least
    1/16. The copy's solver is tightened.
    """
    if context.checks is None:
        return context.undefined()
    own, refined, _ = np.maximum(_ends(context).total, _NO_SPEED).T
    return np.maximum(own / refined, refined / own)


def suspects(context: Context) -> NDArray[np.bool_]:
    """Return (n,) which runs deserve a second look although no label says so.

    Something shakes from step to step; a model with actuators does not come to rest under constant
    controls; or a body that was at rest in contact moved far.
    """
    trace, ranges = context.trace, context.trace.control_ranges
    if trace.steps < _FEWEST_STEPS:
        return np.zeros(trace.runs, np.bool_)
    found = unresolved_motion(context) > limits(context.setup.thresholds)[_SHAKING.name]
    if ranges is not None and ranges.shape[1]:
        constant = (ranges[..., 0] == ranges[..., 1]).all(axis=1)
        found |= constant & (_ends(context).total[:, 0] > _MOVING)
    return found | _gave_way(context)


def _gave_way(context: Context) -> NDArray[np.bool_]:
    """Return (n,) whether a free body that was at rest in contact moved by a mean body size.

    What falls or rolls from the start was not at rest: in the first tenth of the run it exceeds a
    hundredth of its largest speed.
    """
    trace, found = context.trace, np.zeros(context.trace.runs, np.bool_)
    size = context.setup.mechanism.size if context.setup.mechanism else np.inf
    for body in context.setup.free_bodies:
        speed = np.linalg.norm(context.velocity(body), axis=2)
        rested = speed[:, : 1 + trace.steps // 10].max(axis=1) < 0.01 * speed.max(axis=1)
        found |= rested & (np.linalg.norm(context.displacement(body), axis=1) > size)
    return found & (trace.contacts[:, 0] > 0)


@label(38, (_SHAKING, _REST_RATIO, _TRAVEL))
def step_dependent(runs: MeasuredRuns) -> Found:
    """The outcome depends on the step.

    A copy at a quarter of the step with a tightened solver comes to rest, stays where it was, or
    shakes in every step of its own; a copy from a start 1e-9 away does as the run, so that it is
    not chaos.
    """
    checks = runs.context.checks
    if checks is None:
        return
    for run in range(checks.runs):
        reason = _shakes(runs, run) or _moves(runs, checks, run) or _rests(runs, run)
        if reason:
            yield run, Finding(reason, _parting(runs.context, checks, run))


def _shakes(runs: MeasuredRuns, run: int) -> str:
    """Say which degree of freedom shakes in every step, in the refined copy too or much less."""
    speed, motion, shaking = (each[run] for each in _ends(runs.context))
    limit = runs.limits[_SHAKING.name] * np.array([[1], [1 / REFINEMENT**2], [1]])
    shakes, still, _ = shaking & (motion > limit)
    _, slower, unlike = speed < speed[0] / _LIKE
    found = np.where(shakes & (still | slower) & ~unlike, motion[0], 0)
    if not found.any():
        return ""
    worst = int(found.argmax())
    then = (
        f"still at {speed[1, worst]:.3g}" if still[worst] else f"it moves at {speed[1, worst]:.3g}"
    )
    name = _degrees(runs.context)[0][worst]
    shakes = (
        f"{name} shakes from step to step at {speed[0, worst]:.3g} rad/s or body sizes a second"
    )
    return f"{shakes}; at a quarter of the step, {then}"


def _moves(runs: MeasuredRuns, checks: SelfChecks, run: int) -> str:
    """Say which body moved from where it stays in the refined copy."""
    own, refined, perturbed = checks.travel[run]
    moved = (own > runs.limits[_TRAVEL.name]) & (refined < _STAYS * own)
    moved &= perturbed**2 > own * refined
    if not moved.any():
        return ""
    body = int(np.where(moved, own, 0).argmax())
    ended = f"{checks.bodies[body]} ended {own[body]:.3g} mean body sizes from its start"
    return f"{ended}; at a quarter of the step, {refined[body]:.3g}"


def _rests(runs: MeasuredRuns, run: int) -> str:
    """Say how fast all moves that is at rest in the refined copy, or the other way round."""
    own, refined, perturbed = _ends(runs.context).total[run].tolist()
    limit = runs.limits[_REST_RATIO.name]
    logs = np.log(np.maximum([own, refined, perturbed], _NO_SPEED))
    parted, chaos = np.abs(logs[0] - logs[1:])
    if not (parted > np.log(limit) and chaos < parted / 2):
        return ""
    ends = f"it moves at {own:.3g} rad/s or body sizes a second at its end"
    return f"{ends}; at a quarter of the step, at {refined:.3g} (limit {limit:g} times)"


def _parting(context: Context, checks: SelfChecks, run: int) -> int:
    """Return the first step in which run and refined copy part by half of all they ever do."""
    apart = np.abs(context.trace.qvel[run] - checks.refined.qvel[run]) / _degrees(context)[1]
    return max(first_step((apart > apart.max(initial=0) / 2).any(axis=1)) - 1, 0)
