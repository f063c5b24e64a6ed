"""Whether an outcome depends on the step: runs against their refined and perturbed copies.

Distance alone tells nothing, since all that tumbles parts from its copies. Speeds are in rad/s, and
in mean body sizes a second for what moves along.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats, SelfChecks, motion_at_rest, squared_lengths
from contactlab.measure.amounts import amount
from contactlab.measure.constraint_violation import OVERSHOOT, constraint_violation
from contactlab.measure.context import (
    Context,
    cached,
    first_step,
    kinetic,
    peak_kinetic,
    runs_where,
    squared_speeds,
)
from contactlab.measure.energy_balance import LOSS, constraint_loss
from contactlab.measure.entries import (
    Found,
    MeasuredRuns,
    Onset,
    Threshold,
    label,
    limits,
    metric,
)
from contactlab.measure.penetration import PRESSED, weights_borne
from contactlab.measure.solver_work import SATURATED, stuck_share

_SHAKING = Threshold(
    "unresolved_motion", 0.6, "1", "Public robots reach 0.2; loops too tight for a step, 2 to 700."
)
_REST_RATIO = Threshold(
    "rest_ratio", 3.0, "1", "Speed at the end over that of the refined copy; robots reach 1.5."
)
_TRAVEL = Threshold(
    "step_travel", 1.0, "1", "Body sizes moved; a tower that collapses by its step moves 15."
)
_UNRESOLVED = 0.15  # Amplitude of what alternates from step to step over speed
# Least speed of what does not come to rest, and one that is as good as none.
_MOVING, _NO_SPEED = 0.1, 1 / 80
# Factor within which a run and a copy are as fast; share of a run's travel that is none.
_LIKE, _STAYS = 3.0, 0.1
# Share of the way that parts run and copy, and within which what is not chaotic ends.
_PARTED, _SAME = 0.2, 1e-6
_RATTLES = 0.1  # Share of the first half's steps in which the number of contacts changes
# Whether degrees of freedom move along, by kind of joint.
_ALONG = {"free": [True] * 3 + [False] * 3, "ball": [False] * 3, "slide": [True], "hinge": [False]}


class _Ends(NamedTuple):
    """Of last quarters of n runs (n, 1, nv) or, with refined and perturbed copies, (n, 3, nv)."""

    speed: Floats  # root mean square
    amplitude: Floats  # of what alternates from step to step of their own

    @property
    def total(self) -> Floats:
        """(n, 1) or (n, 3) root mean square speed over all degrees of freedom."""
        return np.sqrt((self.speed**2).sum(axis=2) / max(self.speed.shape[2], 1))


def _degrees(context: Context) -> tuple[list[str], Floats]:
    """Return the joint of each degree of freedom, and (nv,) what its speeds are divided by."""
    mechanism = context.setup.mechanism
    if mechanism is None:
        return [""] * context.trace.qvel.shape[2], np.ones(1)
    names = [joint.name for joint in mechanism.joints for _ in _ALONG[joint.kind]]
    along = [moves for joint in mechanism.joints for moves in _ALONG[joint.kind]]
    return names, np.where(along, mechanism.size, 1.0)


@cached
def _ends(context: Context) -> _Ends:
    trace, checks = context.trace, context.checks
    joints = context.setup.mechanism.joints if context.setup.mechanism else ()
    own = motion_at_rest(trace.qvel)[:, None] if checks is None else checks.rest
    speed, amplitude = np.moveaxis(own / _degrees(context)[1], 2, 0)
    # A free body hops as it slides or rattles, which chatter and energy judge.
    hinged = [joint.kind != "free" for joint in joints for _ in _ALONG[joint.kind]] or [True]
    aloft = np.asarray(trace.contacts.max(axis=1, initial=0) == 0)[:, None, None]
    hinged = np.array(hinged) | aloft
    return _Ends(speed, amplitude * (amplitude >= _UNRESOLVED * speed) * hinged)


@metric("1", "lower", 1e-9, version=2, kind="detail")
def unresolved_motion(context: Context) -> Floats:
    """Largest acceleration to and fro, from step to step at the end, over 9.81 m/s^2.

    Of those degrees of freedom in which the amplitude of such speeds, the median of their second
    difference over 4, is at least 0.15 of the speed; times the mean body size for those that
    turn. Free joints do not count where there are contacts, since bodies hop as they slide.
    """
    return _to_and_fro(context).max(axis=1, initial=0)


def _to_and_fro(context: Context) -> Floats:
    """Return (n, nv) the acceleration of each degree of freedom from step to step, over gravity."""
    size = context.setup.mechanism.size if context.setup.mechanism else 1.0
    return 2 * size / 9.81 * _ends(context).amplitude[:, 0] / context.trace.timestep[:, None]


def suspects(context: Context) -> NDArray[np.bool_]:
    """Return (n,) which runs deserve a second look although no label says so.

    It has what shakes in its steps, is pressed hard at rest or against a limit, has a solver that
    uses all its iterations, does not come to rest under constant controls, loses half of its
    kinetic energy in a step, or has a body that moved far from where it rested or rattled.
    """
    trace, ranges = context.trace, context.trace.control_ranges
    size = context.setup.mechanism.size if context.setup.mechanism else np.inf
    most = limits(context.setup.thresholds)
    found = unresolved_motion(context) > most[_SHAKING.name]
    found |= weights_borne(context) > most[PRESSED.name]
    found |= stuck_share(context) >= most[SATURATED.name]
    found |= (constraint_loss(context) > most[LOSS.name]) & (stuck_share(context) == 0)
    found |= constraint_violation(context) > most[OVERSHOOT.name]
    if ranges is not None and ranges.shape[1]:
        constant = (ranges[..., 0] == ranges[..., 1]).all(axis=1)
        found |= constant & (_ends(context).total[:, 0] > _MOVING)
    found |= _abrupt(context)
    changes = (np.diff(trace.contacts[:, : trace.steps // 2]) != 0).sum(axis=1)
    rattles = changes > _RATTLES * trace.steps / 2
    squares = squared_speeds(context)
    early = squares[..., : 1 + trace.steps // 10]
    first, fastest = (np.sqrt(speeds.max(axis=2)) for speeds in (early, squares))
    for body, rested in zip(context.setup.free_bodies, first < 0.01 * fastest, strict=True):
        # What falls or rolls from the start was not at rest.
        far = np.sqrt(squared_lengths(context.displacement(body))) > size
        found |= (rested | rattles) & far & (trace.contacts[:, :1] > 0).any(axis=1)
    return found


def _abrupt(context: Context) -> NDArray[np.bool_]:
    """Return (n,) whether a step that begins without contact takes half of the kinetic energy.

    Of at least a quarter of the largest, so that turning points do not count.
    """
    moving = kinetic(context)
    fast = (moving >= peak_kinetic(context)[:, None] / 4) & (context.trace.contacts == 0)
    return (fast[:, :-1] & (moving[:, 1:] < moving[:, :-1] / 2)).any(axis=1)


@label(
    "poor",
    rank=4,
    thresholds=(_SHAKING, _REST_RATIO, _TRAVEL),
    letter="J",
    colour="#83140e",
    advice="shorten the timestep until the outcome stays: contactlab tune MODEL",
)
def step_dependent(runs: MeasuredRuns) -> Found:
    """The outcome depends on the step, and that is not chaos.

    A copy at a quarter of the step comes to rest, stays where it was, or does not shake from step
    to step, or goes another way where steps brake too hard; a copy 1e-9 away does as the run.
    """
    checks = runs.context.checks
    if checks is None:
        return
    for run in runs_where(checks.compared):
        reason = _shakes(runs, run) or _moves(runs, checks, run) or _rests(runs, run)
        reason = reason or _brakes(runs.context, checks, run)
        if reason:
            yield run, Onset(reason, _parting(runs.context, checks, run))


def _shakes(runs: MeasuredRuns, run: int) -> str:
    """Say which degree of freedom shakes from step to step, in the refined copy much less."""
    strength = _to_and_fro(runs.context)[run]
    own, refined, perturbed = _ends(runs.context).amplitude[run]
    found = (strength > runs.limits[_SHAKING.name]) & (_LIKE * refined < own)
    found &= _LIKE * perturbed > own
    worst = int(np.where(found, strength, 0).argmax())
    shaken = f"{_degrees(runs.context)[0][worst]} shakes from step to step"
    return _said(shaken, own[worst], refined[worst]) if found[worst] else ""


def _moves(runs: MeasuredRuns, checks: SelfChecks, run: int) -> str:
    """Say which body moved from where it stays in the refined copy."""
    own, refined, perturbed = checks.travel[run]
    moved = (own > runs.limits[_TRAVEL.name]) & (refined < _STAYS * own)
    moved &= perturbed**2 > own * refined
    body = int(np.where(moved, own, 0).argmax())
    ended = f"{checks.bodies[body]} ended {amount(own[body])} mean body sizes from its start"
    return f"{ended}; at a quarter of the step, {amount(refined[body])}" if moved[body] else ""


def _rests(runs: MeasuredRuns, run: int) -> str:
    """Say how fast all moves that is at rest in the refined copy, or the other way round."""
    total = _ends(runs.context).total[run]
    logs = np.log(np.maximum(total, _NO_SPEED))
    parted, chaos = np.abs(logs[0] - logs[1:])
    found = parted > np.log(runs.limits[_REST_RATIO.name]) and chaos < parted / 2
    return _said("all moves", *total[:2]) if found else ""


def _brakes(context: Context, checks: SelfChecks, run: int) -> str:
    """Say what goes another way in the refined copy, where one step brakes it at once."""
    own, refined, perturbed = checks.travel[run]
    if (
        context.setup.steered
        or not _abrupt(context)[run]
        or (np.abs(perturbed - own) > _SAME * own).any()
    ):
        return ""
    paths = context.trace.qvel[run], checks.refined[run].qvel[0]
    ways = [np.abs(path.sum(axis=0)) * context.trace.timestep[run] for path in paths]
    own, refined = (way / _degrees(context)[1] for way in ways)
    parted = np.abs(own - refined) / np.maximum(np.maximum(own, refined), 1)
    worst = int(parted.argmax())
    name = _degrees(context)[0][worst]
    went = f"{name}, braked at once, ended {own[worst]:.3g} rad or body sizes"
    copied = f"{went} from its start; at a quarter of the step, {refined[worst]:.3g}"
    return copied if parted[worst] > _PARTED else ""


def _said(what: str, speed: float, refined: float) -> str:
    unit = "rad/s or body sizes a second at its end"
    return f"{what} at {amount(speed)} {unit}; at a quarter of the step, at {amount(refined)}"


def _parting(context: Context, checks: SelfChecks, run: int) -> int:
    """Return the first step in which run and refined copy part by half of all they ever do."""
    apart = np.abs(context.trace.qvel[run] - checks.refined[run].qvel[0]) / _degrees(context)[1]
    return max(first_step((apart > apart.max(initial=0) / 2).any(axis=1)) - 1, 0)
