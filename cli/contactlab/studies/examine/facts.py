"""Facts of a model besides its budget: depths, overlaps, creep, forces and masses.

They are not judged, since they may be intended. Numbers have units that people use.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.budget.force_places import contact_name
from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.windows import Run, joint_name, replay_motion
from contactlab.contact.trace_arrays import Floats
from contactlab.measure.run_integrity import find_accepted, find_notes
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.rendering.amounts import format_digits, format_percent
from contactlab.scene.body_inertia import in_words, inertia_faults
from contactlab.scene.compile_model import InertiaFault
from contactlab.scene.contact_pairs import body_reaches
from contactlab.scene.part_bodies import is_mocap_driven
from contactlab.schema.examination import Fact
from contactlab.studies.examine.masked_passages import MaskedPassages
from contactlab.studies.lint.static_equilibrium import MANY_WEIGHTS, find_pressing
from contactlab.tasks.checked_model import CheckedModel

_PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
_DEEP = 0.05  # of half the thinner geom, a range or a body's size, up to which a start is ordinary
_ENDS_MEET = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))


class _Contact(NamedTuple):
    """The deepest contact, or the one with the largest force, of some states."""

    pair: str
    amount: float  # [m] or [N]
    share: float  # of the thinner geom's smallest half extent, or of the model's weight
    time: float  # [s], of the run


class _Gap(NamedTuple):
    """The gap between the ends of an equality in one state."""

    equality: int
    amount: float  # [m]
    time: float  # [s], of the run
    is_start: bool


def list_facts(motions: Sequence[Motion], begins: Sequence[float]) -> tuple[Fact, ...]:
    """Return the facts of a model's motions, whose phases begin at these times [s] of the run."""
    model = motions[0].model
    data = mujoco.MjData(model)
    deepest, hardest, overlap = list[_Contact](), list[_Contact](), list[_Contact]()
    gaps = list[_Gap]()
    creep, pressing, masked = tuple[Fact, ...](), tuple[Fact, ...](), MaskedPassages(model)
    for motion, begin in zip(motions, begins, strict=True):
        window_seconds = 0.01  # between states that are looked at
        run = replay_motion(motion, window_seconds, 1)
        times = begin + run.begins * model.opt.timestep
        for seed in range(motion.seeds):
            for place in np.flatnonzero(run.valid[seed]):
                start_facts = list(
                    _measure_contacts(model, data, run.starts[seed, place], float(times[place]))
                )
                deepest += [contact for contact, _ in start_facts]
                hardest += [contact for _, contact in start_facts]
                time, is_start = float(times[place]), not place and not begin
                apart = _measure_gaps(model, data).items()
                gaps += [_Gap(equality, gap, time, is_start) for equality, gap in apart]
                if is_start:
                    overlap += [contact for contact, _ in start_facts]
        if motion is motions[0]:
            creep, pressing = tuple(_of_creep(motion, run)), tuple(_of_force(motion, run))
        masked.enter(motion, run, begin)
    return (
        *_of_depth(deepest, overlap),
        *creep,
        *_of_margin(deepest, hardest),
        *masked.facts(),
        *_find_joint_off_limits(motions[0]),
        *_of_equalities(motions[0], gaps),
        *pressing,
    )


def explain_depth(found: Iterable[Fact], examined: CheckedModel) -> Iterator[Fact]:
    """Yield facts, the one of depth with the reason why the labels of runs accept an overlap."""
    records = [run.record for run in examined.runs] if examined.has_run else []
    reasons = (find_accepted(label.reason) for record in records for label in record.labels)
    accepted = next(filter(None, reasons), "")
    for fact in found:
        if fact.kind == "depth" and accepted:
            sentence = f"{fact.sentence}; accepted: {examined.name_geoms(accepted)}"
            yield fact.model_copy(update={"sentence": sentence})
        else:
            yield fact


def list_run_notes(examined: CheckedModel) -> Iterator[Fact]:
    """Yield the notes of stable runs: a limit far off, a body that falls at the end; each once."""
    known = set[str]()
    for record in (run.record for run in examined.runs) if examined.has_run else ():
        for note in find_notes(record.labels[0].reason):
            found = re.fullmatch("(the limit of )?(.+) (is off by|falls at the end).*", note)
            if found is None or found[2] in known:
                continue
            known.add(found[2])
            kind, metric, unit = ("limit", "constraint_violation", "1")
            if not found[1]:
                kind, metric, unit = ("fall", "drop", "m")
            yield Fact(
                kind=kind,
                place=found[2],
                value=record.metrics[metric] or 0.0,
                unit=unit,
                sentence=note,
            )


def _measure_contacts(
    model: mujoco.MjModel, data: mujoco.MjData, state: Floats, time: float
) -> Iterator[tuple[_Contact, _Contact]]:
    """Yield each contact of a state as a depth and as a force."""
    mujoco.mj_setState(model, data, state, INTEGRATION)
    mujoco.mj_forward(model, data)
    weight = float(model.body_mass.sum() * np.linalg.norm(model.opt.gravity)) or np.inf
    force = np.empty(6)
    for place in range(data.ncon):
        geoms = data.contact.geom[place]
        if geoms.min() < 0 or data.contact.efc_address[place] < 0:
            continue
        mujoco.mj_contactForce(model, data, place, force)
        name, depth = contact_name(model, geoms), -float(data.contact.dist[place])
        thin = min(half_extent(model, int(geom)) for geom in geoms)
        yield (
            _Contact(name, depth, depth / thin, time),
            _Contact(name, float(force[0]), float(force[0]) / weight, time),
        )


def half_extent(model: mujoco.MjModel, geom: int) -> float:
    """Return half of a geom's smallest extent [m]; infinite for a plane or height field."""
    half = model.geom_aabb[geom, 3:]
    return float(half.min()) if half.min() > 0 else np.inf


def _of_depth(deepest: Sequence[_Contact], overlap: Sequence[_Contact]) -> Iterator[Fact]:
    if worst := _find_worst([contact for contact in overlap if contact.share > _DEEP]):
        yield Fact(
            kind="overlap",
            place=worst.pair,
            value=worst.amount,
            unit="m",
            sentence=f"bodies begin inside each other: {_in_words(worst)}",
        )
    if (worst := _find_worst(deepest)) and worst.share > COARSE_ROUNDING:
        yield Fact(
            kind="depth",
            place=worst.pair,
            value=worst.amount,
            unit="m",
            sentence=f"deepest {_in_words(worst)} at {worst.time:.2f} s",
        )


def _of_margin(depths: Sequence[_Contact], forces: Sequence[_Contact]) -> Iterator[Fact]:
    """Yield from how far a contact pushes before touch, within its margin."""
    pushing = zip(depths, forces, strict=True)
    apart = [depth for depth, force in pushing if depth.amount < 0 < force.amount]
    farthest = min(apart, key=lambda contact: contact.amount, default=None)
    if farthest is not None:
        sentence = (
            f"contact force begins {_format_mm(-farthest.amount)} mm before the geoms touch "
            f"(margin): {farthest.pair}, at {farthest.time:.2f} s"
        )
        yield Fact(
            kind="margin", place=farthest.pair, value=-farthest.amount, unit="m", sentence=sentence
        )


def _find_worst(contacts: Sequence[_Contact]) -> _Contact | None:
    return max(contacts, key=lambda contact: contact.amount, default=None)


def _in_words(contact: _Contact) -> str:
    share = f"{format_percent(contact.share)} of the thinner geom's half thickness"
    return f"{contact.pair}, {_format_mm(contact.amount)} mm ({share})"


def _format_mm(length: float) -> str:
    return format_digits(1e3 * length, 2)


def _of_creep(motion: Motion, run: Run) -> Iterator[Fact]:
    """Yield the contact that creeps fastest at the end of a phase, within its cone of friction.

    It touches, and does not slide, in all states of the last fifth. Its creep is the mean velocity
    of one surface along the other: a rolling body does not slip, and a motion back cancels.
    """
    end_share = 0.2  # of the first phase, in which a body at rest may creep
    step = motion.model.opt.timestep
    late = np.flatnonzero(run.valid[0] & (run.begins >= (1 - end_share) * motion.steps))
    data, states = mujoco.MjData(motion.model), list[dict[tuple[int, int], Floats]]()
    for place in late:
        mujoco.mj_setState(motion.model, data, run.starts[0, place], INTEGRATION)
        mujoco.mj_forward(motion.model, data)
        states.append(_creep_velocities(motion.model, data))
    common_pairs = set[tuple[int, int]].intersection(*map(set, states)) if states else set()
    speeds = {
        pair: float(np.linalg.norm(np.mean([state[pair] for state in states], axis=0)))
        for pair in common_pairs
    }
    if not speeds:
        return
    pair = max(speeds, key=lambda pair: speeds[pair])
    still = 1e-3  # half extents of a geom in a second, below which it does not creep
    if (speed := speeds[pair]) <= still * min(half_extent(motion.model, geom) for geom in pair):
        return
    place = contact_name(motion.model, np.array(pair))
    sentence = (
        f"{place} creeps {_format_mm(speed)} mm/s while friction could hold it, "
        f"{(1 - end_share) * motion.steps * step:.2g} to {motion.steps * step:.2g} s"
    )
    yield Fact(kind="creep", place=place, value=speed, unit="m/s", sentence=sentence)


def _creep_velocities(model: mujoco.MjModel, data: mujoco.MjData) -> dict[tuple[int, int], Floats]:
    speeds_by_pair, slides = dict[tuple[int, int], list[Floats]](), set[tuple[int, int]]()
    force, ways = np.empty(6), np.empty((2, 3, model.nv))
    held_share = 0.95  # of a cone of friction: beyond, a contact slides
    for place in range(data.ncon):
        contact = data.contact[place]
        one, two = pair = min(contact.geom), max(contact.geom)
        if one < 0 or contact.efc_address < 0:
            continue
        mujoco.mj_contactForce(model, data, place, force)
        shares = np.abs(force[1:3]) / np.maximum(contact.friction[:2], np.finfo(float).tiny)
        cone = shares.sum() if model.opt.cone == _PYRAMIDAL else np.linalg.norm(shares)
        has_friction = contact.dim > 1
        if not has_friction or cone >= held_share * force[0]:
            slides.add(pair)
            continue
        for way, geom in zip(ways, (one, two), strict=True):
            mujoco.mj_jac(model, data, way, None, contact.pos, int(model.geom_bodyid[geom]))
        belts = [_surface_velocity(model, data, geom, contact.pos) for geom in (one, two)]
        speed, normal = (ways[1] - ways[0]) @ data.qvel + belts[1] - belts[0], contact.frame[:3]
        speeds_by_pair.setdefault(pair, []).append(speed - normal * (normal @ speed))
    return {
        pair: np.mean(speeds, axis=0)
        for pair, speeds in speeds_by_pair.items()
        if pair not in slides
    }


def _surface_velocity(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, place: Floats
) -> Floats:
    """Return (3,) the velocity of a geom's surface along the geom, like a belt's, at a place."""
    surface = getattr(model, "geom_surfacevel", np.zeros((model.ngeom, 6)))[geom]
    turned = data.geom_xmat[geom].reshape(3, 3)
    linear, angular = turned @ surface[:3], turned @ surface[3:]
    return linear + np.cross(angular, place - data.geom_xpos[geom])


def _find_joint_off_limits(motion: Motion) -> Iterator[Fact]:
    model, data = motion.model, mujoco.MjData(motion.model)
    mujoco.mj_setState(model, data, motion.starts[0], INTEGRATION)
    single = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)
    limited = (model.jnt_limited > 0) & np.isfinite(model.jnt_range).all(axis=1)
    joints = np.flatnonzero(single & limited)
    at, (low, high) = data.qpos[model.jnt_qposadr[joints]], model.jnt_range[joints].T
    beyond = np.maximum(low - at, at - high)
    shares = beyond / np.maximum(high - low, np.finfo(float).tiny)
    if not (shares > _DEEP).any():
        return
    # The largest in mm, at the end of the body for a hinge.
    hinges = model.jnt_type[joints] == int(mujoco.mjtJoint.mjJNT_HINGE)
    levers = np.where(hinges, body_reaches(model)[model.jnt_bodyid[joints]], 1.0)
    worst = int(np.where(shares > _DEEP, beyond * levers, -np.inf).argmax())
    joint, amount = int(joints[worst]), float(beyond[worst])
    turns = int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_HINGE
    amount_text = (
        f"{format_digits(np.degrees(amount), 2)} deg" if turns else f"{_format_mm(amount)} mm"
    )
    others = int((shares > _DEEP).sum()) - 1
    are = "are" if others > 1 else "is"
    more = f" ({others} more {are}, too)" if others else ""
    yield Fact(
        kind="limit",
        place=(name := joint_name(model, joint)),
        value=amount,
        unit="rad" if turns else "m",
        sentence=f"at the start {name} is {amount_text} beyond its range{more}; begin from a "
        "keyframe within it",
    )


def _measure_gaps(model: mujoco.MjModel, data: mujoco.MjData) -> dict[int, float]:
    # Distance between the ends of each connect and weld [m]; `data` has its constraints.
    rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return {
        equality: float(np.linalg.norm(data.efc_pos[rows[data.efc_id[rows] == equality][:3]]))
        for equality in np.flatnonzero(np.isin(model.eq_type, _ENDS_MEET)).tolist()
    }


def _of_equalities(motion: Motion, gaps: Sequence[_Gap]) -> Iterator[Fact]:
    """Yield the connect or weld with ends farthest apart at the start, otherwise in the run.

    A gap of less than a twentieth of the mean size of bodies is ordinary.
    """
    model = motion.model
    at_start = [gap for gap in gaps if gap.is_start]
    most = _DEEP * model.stat.meansize
    for gap_group in (at_start, gaps):
        worst = max(gap_group, key=lambda gap: gap.amount, default=None)
        if worst is None or worst.amount <= most:
            continue
        place = f"equality {model.equality(worst.equality).name or f'[{worst.equality}]'}"
        led = bool(is_mocap_driven(model)[worst.equality])
        advice = "place its mocap body there" if led else "begin where they meet"
        gap = f"{_format_mm(worst.amount)} mm apart"
        sentence = f"the ends of {place} come {gap}, at {worst.time:.2f} s"
        if worst.is_start:
            sentence = (
                f"at the start the ends of {place} are {gap}, and it draws them together; "
                f"{advice}, for example by a keyframe"
            )
        yield Fact(kind="equality", place=place, value=worst.amount, unit="m", sentence=sentence)
        return


def _of_force(motion: Motion, run: Run) -> Iterator[Fact]:
    """Yield the bodies that joints press on each other at the end of the first phase."""
    valid, model = np.flatnonzero(run.valid[0]), motion.model
    if not valid.size:
        return
    data, loads = mujoco.MjData(model), dict[str, float]()
    mujoco.mj_setState(model, data, run.starts[0, valid[-1]], INTEGRATION)
    for pressed in find_pressing(model, data.qpos):
        place = contact_name(model, np.array(pressed.geoms))
        loads[place] = loads.get(place, 0.0) + pressed.weights
    place = max(loads, key=lambda place: loads[place], default="")
    if place and loads[place] > MANY_WEIGHTS:
        size = "over 1,000" if loads[place] > 1000 else format_digits(loads[place], 2)
        sentence = (
            f"{place} presses at rest with {size} times the weight of all that moves, and no motor "
            "presses it: joints hold the bodies in each other"
        )
        weight = float(model.body_mass[model.body_weldid > 0].sum())
        force = loads[place] * weight * float(np.linalg.norm(model.opt.gravity))
        yield Fact(kind="force", place=place, value=force, unit="N", sentence=sentence)


def list_inertia_facts(model: mujoco.MjModel) -> Iterator[Fact]:
    """Yield the bodies with masses or inertias that no shape or density has."""
    alike: dict[tuple[str, float], list[InertiaFault]] = {}
    for fault in inertia_faults(model):
        alike.setdefault((fault.kind, fault.limit), []).append(fault)
    for faults in alike.values():
        first, (sentence,) = faults[0], in_words(faults)
        yield Fact(
            kind="inertia", place=first.body, value=first.value, unit=first.unit, sentence=sentence
        )
