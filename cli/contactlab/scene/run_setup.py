"""Builds the setup of a group of runs, for measurements that need more than traces."""

import re
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from contactlab.contact.contact_laws import stiffness_damping
from contactlab.contact.rotations import rotate_vectors_back
from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import (
    QUARTER_TURN,
    Barrier,
    Equality,
    FreeBody,
    HoldWindow,
    Joints,
    Mechanism,
    Part,
    PartKind,
    Setup,
)
from contactlab.mjcf import AT_REST
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import (
    MonitoredPair,
    body_reaches,
    colliding_geoms,
    effective_parameters,
    half_extents,
)
from contactlab.scene.initial_states import quaternion_indices
from contactlab.scene.model_edits import read_flag
from contactlab.scene.model_names import is_address, name_of
from contactlab.scene.part_bodies import (
    AT_JOINT,
    bodies_of_actuator,
    bodies_of_equality,
    bodies_of_tendon,
    is_mocap_driven,
    moving_bodies,
)
from contactlab.scene.requirements import RunRequirement, expected_of_runs
from contactlab.scene.run_spec import RunSpec, settings_table
from contactlab.scene.task import rest_time
from contactlab.schema.drive import Drive, FileDrive, drive_word
from contactlab.schema.scene_manifest import SceneManifest

_GEOM_TYPES = mujoco.mjtGeom
_OVERRIDE_FLAG = mujoco.mjtEnableBit.mjENBL_OVERRIDE
_STEADY_DRIVES = ("none", "hold")
_FORCE_COORDINATE = re.compile(r"\.[ft][xyz]$")


def measurement_key(run: RunSpec, model: mujoco.MjModel) -> Hashable:
    """Return the key that runs of one structure must share to be recorded and measured together.

    `Setup` and the energy ledger hold one value for all runs of a group.
    """
    return drive_word(run.drive), _may_push(run.drive), _model_kind(model)


# Caches of one: each holds a model.
@lru_cache(maxsize=1)
def _model_kind(model: mujoco.MjModel) -> Hashable:
    """Return the model's part of the key, which runs of the model share."""
    acts = is_passive(model), is_conservative(model), has_other_forces(model), has_springs(model)
    acts += (has_moving_surfaces(model), has_yielding_springs(model))
    # Inputs that decide a pair's solimp width.
    mixed = model.geom_solimp[:, 2], model.geom_solmix, model.geom_priority
    widths = *mixed, model.pair_solimp[:, 2], model.opt.o_solimp[2:3]
    yields = tuple(width.tobytes() for width in widths)
    return acts, yields, model.opt.integrator, model.opt.enableflags & _OVERRIDE_FLAG


def make_setup(
    base: CompiledScene,
    manifest: SceneManifest | None,
    runs: Sequence[RunSpec],
    models: Sequence[mujoco.MjModel],
    thresholds: Mapping[str, float],
    run_requirements: Sequence[RunRequirement] = (),
) -> Setup:
    """Return the setup of n runs of one structure, with the requirements of their sweep."""
    bodies, holding = _free_bodies(models), base.holding
    windows = [holding.hold_window(run.initial) for run in runs] if holding else []
    oracle = manifest.oracle if manifest else None
    distinct = list({id(model): model for model in models}.values())
    passive = all(map(is_passive, distinct)) and not _is_pushed(manifest, runs)
    return Setup(
        settings=settings_table(runs) | _settings_at_rest(base, runs, models),
        elliptic=np.array([model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC for model in models]),
        iterations=np.array([model.opt.iterations for model in models], np.int32),
        gravity=np.array([model.opt.gravity * read_flag(model, "gravity") for model in models]),
        moving_mass=np.array([model.body_mass[model.body_weldid != 0].sum() for model in models]),
        size=float(base.model.stat.meansize),
        exact=float(base.model.opt.ccd_tolerance),
        steered=any(drive_word(run.drive) not in _STEADY_DRIVES for run in runs),
        conveying=any(map(has_moving_surfaces, distinct)),
        undriven=_undriven_time(manifest, runs) if all(map(is_passive, distinct)) else 0.0,
        yielding=any(map(has_yielding_springs, distinct)),
        passive=passive,
        conservative=passive and all(map(is_conservative, distinct)),
        free_bodies=tuple(bodies.values()),
        # The planes and boxes fixed to the world that free bodies can touch.
        barriers=tuple(
            Barrier(body=bodies[root], **wall) for root, wall in _find_walls(base) if root in bodies
        ),
        **_mechanism_entries(base),
        **_pair_entries(base, models[0]),
        slots=np.array([pair.slots for pair in base.pairs], np.int32),
        duration=np.array([run.duration for run in runs]),
        contact_time=np.array([_longest_contact_time(model) for model in models]),
        limits_act=np.array([read_flag(model, "limit") for model in models]),
        speculative=np.array([run.flags.get("speculative", False) for run in runs]),
        expected=expected_of_runs(base, manifest, runs, models, run_requirements),
        oracle=oracle.name if oracle else None,
        oracle_tolerance=oracle.tolerance if oracle else np.inf,
        thresholds={**(manifest.thresholds if manifest else {}), **thresholds},
        hold=HoldWindow(*np.transpose(windows)) if holding else None,
        springs=any(map(has_springs, distinct)),
    )


@lru_cache(maxsize=1)
def _mechanism_entries(base: CompiledScene) -> Mapping[str, Any]:
    """Return the setup entries of joints and mechanism, which runs of a structure share."""
    return {"quaternions": quaternion_indices(base.model), "mechanism": find_mechanism(base.model)}


@lru_cache(maxsize=1)
def _pair_entries(base: CompiledScene, model: mujoco.MjModel) -> Mapping[str, Any]:
    """Return the setup entries of each pair, which runs of the model share."""
    # Half the smallest extent of the thinnest geom that can collide [m]. If geoms differ in the
    # width of their solimp, only the widest deform.
    halves = half_extents(base.model)
    widths = np.where(np.isfinite(halves), base.model.geom_solimp[:, 2], -np.inf)
    colliding = colliding_geoms(base.model, base.pairs)
    touching = [np.array(geoms, np.intp).ravel() for geoms in colliding]
    soft = (geoms[widths[geoms] == widths[geoms].max(initial=-np.inf)] for geoms in touching)
    return {
        "thickness": np.array([halves[geoms].min(initial=np.inf) for geoms in soft]),
        "reaches": np.array([_smallest_diameter(base.model, pair) for pair in base.pairs]),
        "widths": np.array([effective_parameters(model, pair).solimp[2] for pair in base.pairs]),
        "masses": np.array([lighter_mass(base.model, pair) for pair in base.pairs]),
        "sides": tuple(_movable_bodies(base.model, pair) for pair in base.pairs),
    }


def _longest_contact_time(model: mujoco.MjModel) -> float:
    # Mixed solrefs lie between those of both geoms.
    solrefs = np.concatenate([model.geom_solref, model.pair_solref])
    if model.opt.enableflags & _OVERRIDE_FLAG:
        solrefs = model.opt.o_solref[None]
    stiffness, _ = stiffness_damping(solrefs)
    return float(1 / np.sqrt(stiffness.min())) if stiffness.size and stiffness.min() > 0 else 0.0


def _settings_at_rest(
    base: CompiledScene, runs: Sequence[RunSpec], models: Sequence[mujoco.MjModel]
) -> dict[str, list[object]]:
    """Return the derived solref and solimp of runs, if any of them sets contacts at rest.

    They are NaN for runs in which pairs differ.
    """
    asking = [bool(run.changed_settings & AT_REST.keys()) for run in runs]
    if not any(asking):
        return {}
    return {
        name: [
            _common_parameter(base, model, name) if asks else run.settings[name]
            for run, model, asks in zip(runs, models, asking, strict=True)
        ]
        for name in ("solref", "solimp")
    }


def _common_parameter(base: CompiledScene, model: mujoco.MjModel, name: str) -> tuple[float, ...]:
    every = np.array([getattr(effective_parameters(model, pair), name) for pair in base.pairs])
    same = np.isclose(every, every[0], rtol=SUM_ROUNDING).all()
    return tuple((every[0] if same else np.full(every.shape[1], np.nan)).tolist())


def is_passive(model: mujoco.MjModel) -> bool:
    """Return whether nothing drives a model: no actuator, plug-in, wind or moving surface."""
    driven = model.nu or model.nplugin or model.opt.wind.any() or model.body_gravcomp.any()
    return not driven and not has_moving_surfaces(model)


def has_moving_surfaces(model: mujoco.MjModel) -> bool:
    """Return whether a geom's surface moves while the geom rests, like a belt's; since 4.0."""
    return bool(getattr(model, "geom_surfacevel", np.zeros(1)).any())


def is_conservative(model: mujoco.MjModel) -> bool:
    """Return whether a model has only gravity, springs and contacts, as far as it is known."""
    opt = model.opt
    acts = not is_passive(model) or model.nflex or model.neq or opt.density or opt.viscosity
    limits = model.jnt_limited.any() or model.tendon_limited.any()
    drag = (model.dof_damping, model.dof_frictionloss, model.tendon_damping)
    brakes = any(loss.any() for loss in (*drag, model.tendon_frictionloss))
    return not (acts or limits or brakes)


def has_springs(model: mujoco.MjModel) -> bool:
    """Return whether joints, tendons or flexes store energy as they stretch or bend."""
    of_flexes = model.flex_edgestiffness, model.flex_stiffness, model.flex_bending
    stiff = (model.jnt_stiffness, model.tendon_stiffness, *of_flexes)
    return any(bool(stiffness.any()) for stiffness in stiff)


def has_yielding_springs(model: mujoco.MjModel) -> bool:
    """Return whether springs yield, which takes energy for good; since 4.0."""
    names = "jnt_springyield", "tendon_springyield", "flex_yield"
    return any(bool(np.any(getattr(model, name, 0))) for name in names)


def has_other_forces(model: mujoco.MjModel) -> bool:
    """Return whether forces other than constraints, actuators, gravity and springs may act."""
    opt = model.opt
    damped = model.dof_damping.any() or model.tendon_damping.any() or model.nflex
    return bool(damped or opt.density or opt.viscosity or model.body_gravcomp.any())


def _may_push(drive: Drive) -> bool:
    return drive == "exercise" or isinstance(drive, FileDrive)


def _is_pushed(manifest: SceneManifest | None, runs: Sequence[RunSpec]) -> bool:
    """Return whether anything besides the model itself may move bodies in any of the runs."""
    initial = manifest.initial.values() if manifest else ()
    pushed = any(_FORCE_COORDINATE.search(name) for setting in initial for name in setting.sets)
    driven = any(_may_push(run.drive) for run in runs)
    return pushed or driven or bool(manifest and manifest.control)


def _undriven_time(manifest: SceneManifest | None, runs: Sequence[RunSpec]) -> float:
    """Return how long all runs rest before an excitation [s]; 0 for other drives."""
    resting = [replace(run, drive="none") for run in runs]
    if _is_pushed(manifest, resting) or {drive_word(run.drive) for run in runs} != {"exercise"}:
        return 0.0
    return min(rest_time(run.duration) for run in runs)


def _free_bodies(models: Sequence[mujoco.MjModel]) -> dict[int, FreeBody]:
    model = models[0]
    masses = np.array([compiled.body_subtreemass for compiled in models])
    weights = np.array([compiled.dof_invweight0 for compiled in models])
    bodies: dict[int, FreeBody] = {}
    for joint in np.flatnonzero(model.jnt_type == _JOINT_TYPES.mjJNT_FREE):
        body = int(model.jnt_bodyid[joint])
        places = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        mass = masses[:, body].copy()
        # The mean of three inverse masses is known; two of them are at least that of the whole.
        share = 1 / (3 * weights[:, places[1]] * mass - 2)
        bodies[body] = FreeBody(name_of(model, "body", body), *places, mass, share)
    return bodies


@lru_cache(maxsize=1)
def _find_walls(base: CompiledScene) -> list[tuple[int, Mapping[str, Any]]]:
    """Return the body that each wall may stop, and the remaining fields of its barrier."""
    model = base.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    walls = list[tuple[int, Mapping[str, Any]]]()
    for index, pair in enumerate(base.pairs):
        for wall, other in ((0, 1), (1, 0)):
            geom, mover = pair.geoms[wall][0], pair.geoms[other][0]
            kind, size = int(model.geom_type[geom]), model.geom_size[geom]
            still = model.body_weldid[model.geom_bodyid[geom]] == 0
            if (
                pair.bodies
                or not still
                or kind not in (_GEOM_TYPES.mjGEOM_PLANE, _GEOM_TYPES.mjGEOM_BOX)
            ):
                continue
            root = int(model.body_weldid[model.geom_bodyid[mover]])
            point, axes = data.geom_xpos[geom].copy(), data.geom_xmat[geom].reshape(3, 3)
            centre = rotate_vectors_back(data.xquat[root], data.geom_xpos[mover] - data.xpos[root])
            thin, reach = 2, np.inf
            if kind == _GEOM_TYPES.mjGEOM_BOX:
                thin = int(np.argmin(size))
                reach = float(np.delete(size, thin).min())
            normal = axes[:, thin].copy()
            geometry = {"point": point, "normal": normal, "reach": reach, "centre": centre}
            walls.append((root, {"pair": index, **geometry}))
    return walls


def _smallest_diameter(model: mujoco.MjModel, pair: MonitoredPair) -> float:
    """Return the diameter of the sphere about the pair's smallest geom [m]."""
    bounds = np.asarray(model.geom_rbound)[[geom for side in pair.geoms for geom in side]]
    return 2 * float(bounds.min(where=bounds > 0, initial=np.inf))


def lighter_mass(model: mujoco.MjModel, pair: MonitoredPair) -> float:
    """Return the mass of the lighter body tree of a pair's sides [kg]."""
    bodies = np.asarray(model.geom_bodyid)[[side[0] for side in pair.geoms]]
    masses = model.body_subtreemass[model.body_rootid[bodies]]
    return float(np.where(model.body_weldid[bodies] > 0, masses, np.inf).min())


def joints_of(model: mujoco.MjModel) -> Joints:
    """Return the joints of a model, with MuJoCo's lengths for their degrees of freedom."""
    kinds = np.asarray(model.jnt_type)
    places, dofs = np.asarray(model.jnt_qposadr), np.asarray(model.jnt_dofadr)
    scalar = (kinds == _JOINT_TYPES.mjJNT_SLIDE) | (kinds == _JOINT_TYPES.mjJNT_HINGE)
    free, ball = kinds == _JOINT_TYPES.mjJNT_FREE, kinds == _JOINT_TYPES.mjJNT_BALL
    turning = [*(dofs[free] + 3), *dofs[ball]]
    return Joints(
        scalars=tuple(places[scalar].tolist()),
        lengths=np.array(model.dof_length[dofs[scalar]]),
        points=tuple(places[free].tolist()),
        rotations=(*(places[free] + 3).tolist(), *places[ball].tolist()),
        reaches=np.array(model.dof_length[turning]) if turning else np.empty(0),
    )


_EQUALITY_TYPES = mujoco.mjtEq
_JOINT_TYPES = mujoco.mjtJoint
_JOINT_KINDS: tuple[PartKind, ...] = ("free", "ball", "slide", "hinge")


def find_mechanism(model: mujoco.MjModel) -> Mechanism:
    """Return the joints, tendons, actuators and equalities of a compiled scene.

    A joint without a name gets its body's name if the body has no other joint.
    """
    lengths = _infinite_if_unlimited(model.tendon_limited, model.tendon_range)
    margins = np.asarray(model.tendon_margin)
    controls = _infinite_if_unlimited(model.actuator_ctrllimited, model.actuator_ctrlrange)
    springs = np.asarray(model.tendon_stiffness) != 0
    springs |= np.any(getattr(model, "tendon_stiffnesspoly", springs[:, None]), axis=1)
    places = _infinite_if_unlimited(model.jnt_limited, model.jnt_range)
    # Limits of forces (nu, 2), with those of the driven joints.
    forces = _infinite_if_unlimited(model.actuator_forcelimited, model.actuator_forcerange)
    for index in np.flatnonzero(np.isin(model.actuator_trntype, AT_JOINT)):
        joint, gear = model.actuator_trnid[index, 0], model.actuator_gear[index, 0]
        if model.jnt_actfrclimited[joint] and gear:
            low, high = np.sort(model.jnt_actfrcrange[joint] / gear)
            forces[index] = max(forces[index, 0], low), min(forces[index, 1], high)
    reach, ends = (
        _body_reaches(model),
        np.where(is_mocap_driven(model), np.inf, equality_reach(model)),
    )
    return Mechanism(
        joints=tuple(
            _describe_joint(model, index, places[index], reach) for index in range(model.njnt)
        ),
        tendons=tuple(
            Part(
                name_of(model, "tendon", index),
                "tendon",
                index,
                *lengths[index],
                margin=margins[index],
                bodies=bodies_of_tendon(model, index),
            )
            for index in range(model.ntendon)
        ),
        actuators=tuple(
            Part(
                name_of(model, "actuator", index),
                "actuator",
                index,
                *controls[index],
                bodies=bodies_of_actuator(model, index),
            )
            for index in range(model.nu)
        ),
        slack=np.where(springs[:, None], np.reshape(model.tendon_lengthspring, (-1, 2)), np.nan),
        forces=forces,
        equalities=tuple(
            _describe_equality(model, index, places, reach, float(ends[index]))
            for index in range(model.neq)
        ),
    )


def _body_reaches(model: mujoco.MjModel) -> Floats:
    """Return (nbody,) the reach of each body [m]; the mean body size for bodies without geoms."""
    reach = body_reaches(model)
    return np.where(reach > 0, reach, model.stat.meansize)


def equality_reach(model: mujoco.MjModel) -> Floats:
    """Return (neq,) the reach [m] of the smaller body of each connect or weld; inf for others.

    If a site holds a body, the reach is measured from the site.
    """
    tied = np.isin(
        model.eq_type, (int(_EQUALITY_TYPES.mjEQ_CONNECT), int(_EQUALITY_TYPES.mjEQ_WELD))
    )
    sited = model.eq_objtype == int(mujoco.mjtObj.mjOBJ_SITE)
    ends = np.stack([model.eq_obj1id, model.eq_obj2id]) * tied
    owners = np.asarray(model.site_bodyid)
    away = np.linalg.norm(model.geom_pos - model.site_pos[:, None], axis=2) + model.geom_rbound
    from_sites = (away * (model.geom_bodyid == owners[:, None])).max(axis=1, initial=0)
    reach = _body_reaches(model)[np.where(sited, 0, ends)]
    reach[:, sited] = np.where(from_sites > 0, from_sites, model.stat.meansize)[ends[:, sited]]
    ends[:, sited] = owners[ends[:, sited]]
    return np.where(ends > 0, reach, np.inf).min(axis=0)


def _describe_equality(
    model: mujoco.MjModel, index: int, places: Floats, reach: Floats, ends: float
) -> Equality:
    kind, first = int(model.eq_type[index]), int(model.eq_obj1id[index])
    name, bodies = name_of(model, "equality", index), bodies_of_equality(model, index)
    if kind == _EQUALITY_TYPES.mjEQ_TENDON:
        # The length of a spatial tendon, or the largest change of a fixed one by one joint: by a
        # quarter turn of a hinge, or a slide along the reach of its body.
        length = float(model.tendon_length0[first])
        wraps = slice(model.tendon_adr[first], model.tendon_adr[first] + model.tendon_num[first])
        if model.wrap_type[wraps.start] == int(mujoco.mjtWrap.mjWRAP_JOINT):
            joints = model.wrap_objid[wraps]
            slides = model.jnt_type[joints] == int(_JOINT_TYPES.mjJNT_SLIDE)
            ways = np.where(slides, reach[model.jnt_bodyid[joints]], QUARTER_TURN)
            length = float(np.abs(model.wrap_prm[wraps] * ways).max())
        return Equality(name, "m", length, bodies=bodies)
    if kind == _EQUALITY_TYPES.mjEQ_FLEX:
        edges = slice(model.flex_edgeadr[first], None)
        lengths = model.flexedge_length0[edges][: model.flex_edgenum[first]]
        return Equality(name, "m", float(lengths.mean()), elastic=True, bodies=bodies)
    if kind != _EQUALITY_TYPES.mjEQ_JOINT:
        return Equality(name, "m", ends, bodies=bodies)
    low, high = places[first].tolist()
    if int(model.jnt_type[first]) == _JOINT_TYPES.mjJNT_HINGE:
        return Equality(name, "rad", min(high - low, QUARTER_TURN), bodies=bodies)
    scale = min(high - low, float(reach[model.jnt_bodyid[first]]))
    return Equality(name, "m", scale, bodies=bodies)


def _infinite_if_unlimited(limited: np.ndarray, ranges: np.ndarray) -> Floats:
    """Return (n, 2) ranges, infinite for unlimited entries."""
    infinite = np.array([-np.inf, np.inf])
    return np.where(np.asarray(limited, bool)[:, None], ranges, infinite).reshape(-1, 2)


def _describe_joint(model: mujoco.MjModel, index: int, places: Floats, reach: Floats) -> Part:
    joint, own = model.joint(index), name_of(model, "joint", index)
    body = int(joint.bodyid[0])
    borrowed = is_address(own) and model.body_jntnum[body] == 1
    low, high = places.tolist()
    kind = _JOINT_KINDS[int(joint.type[0])]
    return Part(
        name=name_of(model, "body", body) if borrowed else own,
        kind=kind,
        place=int(joint.qposadr[0]),
        # The only limit of a ball joint is on its angle.
        low=-np.inf if kind == "ball" else low,
        high=high,
        margin=float(model.jnt_margin[index]),
        reach=float(reach[body]),
        bodies=(name_of(model, "body", body),),
    )


def _movable_bodies(model: mujoco.MjModel, pair: MonitoredPair) -> tuple[str, ...]:
    return moving_bodies(model, model.geom_bodyid[[*pair.geoms[0], *pair.geoms[1]]])
