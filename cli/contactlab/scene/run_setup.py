"""What measurements need to know of a group of runs besides their traces, from their models."""

import re
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from contactlab.contact.trace_setup import Barrier, FreeBody, HoldWindow, Setup
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import MonitoredPair, colliding
from contactlab.scene.initial_states import quaternions
from contactlab.scene.mechanism import find_mechanism
from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.timed_inputs import HoldSpec
from contactlab.schema.drive import FileDrive
from contactlab.schema.scene_manifest import SceneManifest

_GEOM = mujoco.mjtGeom
_PUSH = re.compile(r"\.[ft][xyz]$")


def make_setup(
    base: CompiledScene,
    manifest: SceneManifest | None,
    runs: Sequence[ResolvedRun],
    models: Sequence[mujoco.MjModel],
    thresholds: Mapping[str, float],
) -> Setup:
    """Return the setup of n runs of one structure.

    Args:
        base: their structure.
        manifest: the scene's, if it has one.
        runs: the resolved runs.
        models: each run's model.
        thresholds: label thresholds of the sweep, which override the scene's.
    """
    bodies = _free_bodies(models)
    values = [run.values for run in runs]
    modes = manifest.modes if manifest else None
    oracle = manifest.oracle if manifest else None
    return Setup(
        settings={name: [each[name] for each in values] for name in values[0]},
        elliptic=np.array([model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC for model in models]),
        iterations=np.array([model.opt.iterations for model in models], np.int32),
        gravity=np.array([_gravity(model) for model in models]),
        passive=all(map(_is_passive, models)) and not _is_pushed(manifest, runs),
        quaternions=quaternions(base.model),
        free_bodies=tuple(bodies.values()),
        barriers=tuple(_barriers(base, bodies)),
        thickness=np.array([_thickness(base.model, pair) for pair in base.pairs]),
        slots=np.array([pair.slots for pair in base.pairs], np.int32),
        duration=np.array([run.duration for run in runs]),
        speculative=np.array([run.flags.get("speculative", False) for run in runs]),
        first_mode=modes.first if modes else None,
        last_mode=modes.last if modes else None,
        oracle=oracle.name if oracle else None,
        oracle_tolerance=oracle.tolerance if oracle else np.inf,
        thresholds={**(manifest.thresholds if manifest else {}), **thresholds},
        hold=base.holding and _hold(base.holding, runs),
        mechanism=find_mechanism(base.model),
    )


def _hold(holding: HoldSpec, runs: Sequence[ResolvedRun]) -> HoldWindow:
    windows = np.array([holding.window(run.initial) for run in runs])
    return HoldWindow(windows[:, 0], windows[:, 1])


def _gravity(model: mujoco.MjModel) -> np.ndarray:
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return np.zeros(3) if off else np.array(model.opt.gravity)


def _is_passive(model: mujoco.MjModel) -> bool:
    driven = model.nu or model.nplugin or model.opt.wind.any() or model.body_gravcomp.any()
    return not driven and not getattr(model, "geom_surfacevel", np.zeros(1)).any()


def _is_pushed(manifest: SceneManifest | None, runs: Sequence[ResolvedRun]) -> bool:
    """Return whether anything but the model itself may move bodies in any of the runs."""
    if any(isinstance(run.drive, FileDrive) for run in runs):
        return True
    if manifest is None:
        return False
    pushed = any(_PUSH.search(name) for each in manifest.initial.values() for name in each.sets)
    return pushed or bool(manifest.control)


def _free_bodies(models: Sequence[mujoco.MjModel]) -> dict[int, FreeBody]:
    model = models[0]
    bodies: dict[int, FreeBody] = {}
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        body = int(model.jnt_bodyid[joint])
        bodies[body] = FreeBody(
            name=model.body(body).name,
            qpos=int(model.jnt_qposadr[joint]),
            dof=int(model.jnt_dofadr[joint]),
            mass=np.array([each.body_subtreemass[body] for each in models]),
        )
    return bodies


def _barriers(base: CompiledScene, bodies: Mapping[int, FreeBody]) -> list[Barrier]:
    model = base.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    barriers: list[Barrier] = []
    for index, pair in enumerate(base.pairs):
        for wall, other in ((0, 1), (1, 0)):
            geom, mover = pair.geoms[wall][0], int(model.geom_bodyid[pair.geoms[other][0]])
            still = model.body_weldid[model.geom_bodyid[geom]] == 0
            root = int(model.body_weldid[mover])
            if pair.bodies or not still or root not in bodies:
                continue
            if int(model.geom_type[geom]) in (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_BOX):
                barriers.append(_barrier(model, data, geom, index, bodies[root]))
    return barriers


def _barrier(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, pair: int, body: FreeBody
) -> Barrier:
    axes = np.array(data.geom_xmat[geom]).reshape(3, 3)
    point = np.array(data.geom_xpos[geom])
    if model.geom_type[geom] == int(_GEOM.mjGEOM_PLANE):
        return Barrier(pair, body, point, axes[:, 2], np.inf)
    size = model.geom_size[geom]
    thin = int(np.argmin(size))
    reach = float(np.delete(size, thin).min())
    return Barrier(pair, body, point, axes[:, thin], reach)


def _thickness(model: mujoco.MjModel, pair: MonitoredPair) -> float:
    """Return half the smallest extent of the pair's thinnest geom that can collide [m]."""
    touching = {geom for both in colliding(model, pair) for geom in both}
    return min((_half_extent(model, geom) for geom in touching), default=np.inf)


def _half_extent(model: mujoco.MjModel, geom: int) -> float:
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind in (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD):
        return np.inf
    if kind in (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_CAPSULE):
        return float(size[0])
    if kind == _GEOM.mjGEOM_CYLINDER:
        return float(size[:2].min())
    return float(model.geom_aabb[geom, 3:].min())
