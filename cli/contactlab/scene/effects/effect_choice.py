"""Which effects are on in a run, and why: by what its structure and initial state decide."""

from collections.abc import Collection, Mapping

import mujoco
import numpy as np

from contactlab.scene.compile_model import PREFIX
from contactlab.scene.effects.effect import NOT_IN_MODEL, Effect, EffectRequest, EffectState
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.effects.proofs import ModelFacts, RunState, tendons_act
from contactlab.scene.initial_states import InitialStates

_GEOM = mujoco.mjtGeom
_JOINT = mujoco.mjtJoint
# Of more geoms, which can touch is not determined: the table of all pairs would be too large.
_MAX_GEOMS = 2000


def find_facts(model: mujoco.MjModel, *, energy: bool) -> ModelFacts:
    """Return the facts of a compiled model, recording sensors included."""
    touch = _touching(model)
    return ModelFacts(
        kinds=_kinds(model, touch),
        level=touch is not None and _is_level(model, touch),
        turning=touch is None or _can_turn(model, touch),
        crowded=bool(model.nflex or (np.asarray(model.body_geomnum) > 1).any()),
        sensors=len(spare_sensors(model)),
        tendons=int(model.ntendon),
        idle_tendons=_are_idle(model),
        energy=energy,
    )


def is_straight(model: mujoco.MjModel, start: InitialStates) -> bool:
    """Return whether everything at a start (n being 1) moves, and is pushed, along z at most."""
    free = np.asarray(model.jnt_dofadr)[model.jnt_type == int(_JOINT.mjJNT_FREE)]
    sideways = np.delete(start.qvel[0], free + 2)
    pushed = np.delete(start.applied[0].reshape(-1, 6), 2, axis=1)
    return not (sideways.any() or pushed.any() or start.driven.size)


def spare_sensors(model: mujoco.MjModel) -> list[int]:
    """Return the ids of sensors that do not record the run, but for those of MuJoCo plugins."""
    return [
        index
        for index in range(model.nsensor)
        if not model.sensor(index).name.startswith(PREFIX)
        and model.sensor_type[index] != mujoco.mjtSensor.mjSENS_PLUGIN
    ]


def _touching(model: mujoco.MjModel) -> np.ndarray | None:
    """Return (n, 2) pairs of geoms that could touch, or None if that is unknown.

    A superset of what MuJoCo lets touch: parents and children, and exclusions, are not filtered.
    """
    if model.nflex or model.nplugin or model.ngeom > _MAX_GEOMS:
        return None
    if model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
        return None
    kind, affinity = np.asarray(model.geom_contype), np.asarray(model.geom_conaffinity)
    weld = np.asarray(model.body_weldid)[model.geom_bodyid]
    bits = (kind[:, None] & affinity[None, :]) | (kind[None, :] & affinity[:, None])
    possible = (bits != 0) & (weld[:, None] != weld[None, :])
    filtered = np.argwhere(np.triu(possible, 1))
    listed = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    return np.concatenate([filtered, listed]).astype(np.intp)


def _kinds(model: mujoco.MjModel, touch: np.ndarray | None) -> frozenset[tuple[int, int]] | None:
    if touch is None:
        return None
    types = np.sort(np.asarray(model.geom_type)[touch], axis=1)
    flat = {int(_GEOM.mjGEOM_PLANE), int(_GEOM.mjGEOM_HFIELD)}
    pairs = {(int(first), int(second)) for first, second in types}
    return frozenset(pair for pair in pairs if not set(pair) <= flat)


def _is_level(model: mujoco.MjModel, touch: np.ndarray) -> bool:
    if model.nu or model.neq or model.ntendon or model.nplugin or model.nmocap:
        return False
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return bool(len(touch)) and all(_is_level_pair(model, data, *pair) for pair in touch)


def _is_level_pair(model: mujoco.MjModel, data: mujoco.MjData, first: int, second: int) -> bool:
    plane, sphere = sorted((first, second), key=lambda geom: int(model.geom_type[geom]))
    types = (int(model.geom_type[plane]), int(model.geom_type[sphere]))
    if types != (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_SPHERE):
        return False
    body = int(model.geom_bodyid[sphere])
    normal = np.asarray(data.geom_xmat[plane]).reshape(3, 3)[:, 2]
    fixed = int(model.body_weldid[model.geom_bodyid[plane]]) == 0
    return bool(fixed and not normal[:2].any() and _is_free_sphere(model, body, sphere))


def _is_free_sphere(model: mujoco.MjModel, body: int, geom: int) -> bool:
    """Return whether a body is free, alone, and has its centre of mass at a geom's centre."""
    free = model.body_jntnum[body] == 1 and (
        model.jnt_type[model.body_jntadr[body]] == _JOINT.mjJNT_FREE
    )
    alone = model.body_parentid[body] == 0 and not (np.asarray(model.body_parentid) == body).any()
    centred = np.array_equal(model.geom_pos[geom], model.body_ipos[body])
    return bool(free and alone and centred)


def _can_turn(model: mujoco.MjModel, touch: np.ndarray) -> bool:
    bodies = np.unique(np.asarray(model.geom_bodyid)[touch.ravel()])
    return any(_turns(model, int(body)) for body in bodies) or bool(model.nmocap)


def _turns(model: mujoco.MjModel, body: int) -> bool:
    """Return whether a joint between a body and the world can turn it."""
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if any(model.jnt_type[first : first + count] != _JOINT.mjJNT_SLIDE):
            return True
        body = int(model.body_parentid[body])
    return False


def _are_idle(model: mujoco.MjModel) -> bool:
    """Return whether no tendon acts, or is used by more than sensors that can be left out."""
    if not model.ntendon:
        return True
    driven = (np.asarray(model.actuator_trntype) == mujoco.mjtTrn.mjTRN_TENDON).any()
    tied = (np.asarray(model.eq_type) == mujoco.mjtEq.mjEQ_TENDON).any()
    return not (tendons_act(model) or driven or tied or model.nplugin)


_COMPILED = ("sensor", "tendon", "energy")


def choose(run: RunState, request: EffectRequest) -> dict[str, EffectState]:
    """Decide every effect of a run, into whose model its settings and request are written."""
    return {name: _choose(effect, run, request) for name, effect in EFFECTS.items()}


def leave_out(run: RunState, chosen: Mapping[str, EffectState]) -> None:
    """Turn off the effects that are not chosen in a run's model, in place."""
    # All are read before any is written: friction effects share condim.
    off = [each for name, each in EFFECTS.items() if not chosen[name].on and each.switch.is_on(run)]
    for effect in off:
        effect.switch.write(run.model, False)


def _choose(effect: Effect, run: RunState, request: EffectRequest) -> EffectState:
    on = effect.switch.is_on(run)
    if effect.name in request.requested:
        # A tendon that is left out may still be in the model, idle.
        requested = request.requested[effect.name] or effect.name not in _COMPILED
        return EffectState(on and requested, "as asked")
    if not on:
        return EffectState(on=False, reason=NOT_IN_MODEL)
    if not request.auto:
        return EffectState(on=True, reason="all that the model has is on")
    if set_here := sorted(request.changed.intersection(effect.switch.settings)):
        return EffectState(on=True, reason=f"the sweep sets {', '.join(set_here)}")
    proof = effect.unused(run)
    return EffectState(proof is None, proof or effect.called_by)


def left_uncompiled(facts: ModelFacts, request: EffectRequest) -> frozenset[str]:
    """Return the effects that a run's model is compiled without, by facts of the whole model."""
    requested, default = request.requested, not request.auto
    out: set[str] = set()
    if facts.sensors and not requested.get("sensor", default):
        out.add("sensor")
    read = facts.sensors and "sensor" not in out
    named = any(name.startswith("tendon_") for name in request.changed)
    spare = facts.tendons and facts.idle_tendons and not read and not named
    if spare and not requested.get("tendon", default):
        out.add("tendon")
    if not requested.get("energy", True):
        out.add("energy")
    return frozenset(out)


def remove(spec: mujoco.MjSpec, without: Collection[str]) -> None:
    """Delete sensors and tendons from a model's specification, before its run's own are added."""
    for sensor in list(spec.sensors) if "sensor" in without else ():
        if not sensor.name.startswith(PREFIX) and sensor.type != mujoco.mjtSensor.mjSENS_PLUGIN:
            spec.delete(sensor)
    for tendon in list(spec.tendons) if "tendon" in without else ():
        spec.delete(tendon)
