"""Plays the first seed of a model's task by plain steps: how fast it is, and a small film of it."""

import io
import time
from collections.abc import Iterator, Sequence
from itertools import chain

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.contact.trace_arrays import Floats
from contactlab.view.film import draw_background, set_looks

_TIMED = 0.5  # CPU that the clock tells well [s]
_FRAMES, _HEIGHT, _WIDTH = 12, 130, 208
_DISTANCE = 2.6  # of the camera, over the radius of what moves
_MILLISECONDS, _QUALITY = 250, 30


def real_time(motions: Sequence[Motion]) -> float:
    """Return simulated over CPU time of the steps of a task, played until the clock tells."""
    model = motions[0].model
    data, seconds = mujoco.MjData(model), model.opt.timestep * sum(one.steps for one in motions)
    simulated, begin = 0.0, time.process_time()
    while (spent := time.process_time() - begin) < _TIMED:
        for motion in motions:
            for _ in _steps(motion, data):
                pass
        simulated += seconds
    return simulated / spent


def moments(motions: Sequence[Motion]) -> Floats:
    """Return states of a task at equal times, (frames, nstate) of mjSTATE_INTEGRATION."""
    model = motions[0].model
    data, size = mujoco.MjData(model), mujoco.mj_stateSize(model, INTEGRATION)
    wanted = {*np.linspace(0, sum(one.steps for one in motions) - 1, _FRAMES).astype(int).tolist()}
    seen = np.empty((len(wanted), size))
    steps = chain.from_iterable(_steps(motion, data) for motion in motions)
    found = (place for place, _ in enumerate(steps) if place in wanted)
    for row, _ in zip(seen, found, strict=True):
        mujoco.mj_getState(model, data, row, INTEGRATION)
    return seen


def _steps(motion: Motion, data: mujoco.MjData) -> Iterator[None]:
    """Make the steps of the first seed of a phase, one by one."""
    mujoco.mj_setState(motion.model, data, motion.starts[0], INTEGRATION)
    rows = motion.rows(0, np.arange(motion.steps))
    for step in range(motion.steps):
        if rows is not None:
            mujoco.mj_setState(motion.model, data, rows[step], motion.spec)
        mujoco.mj_step(motion.model, data)
        yield


def _moves(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Return (ngeom,) which geoms a camera looks at: those of moving bodies, else all."""
    ends = (model.geom_rbound > 0) & (model.body_weldid[model.geom_bodyid] > 0)
    return ends if ends.any() else np.ones(model.ngeom, bool)


def film(model: mujoco.MjModel, states: Floats) -> bytes:
    """Return states as an animated WebP, seen by a camera that follows what moves.

    Raises:
        mujoco.FatalError: nothing draws here.
    """
    set_looks(model, (_WIDTH, _HEIGHT))
    data, camera = mujoco.MjData(model), mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    moving = np.flatnonzero(_moves(model))
    pictures, stored = list[Image.Image](), io.BytesIO()
    with mujoco.Renderer(model, _HEIGHT, _WIDTH) as renderer:
        for state in states:
            mujoco.mj_setState(model, data, state, INTEGRATION)
            mujoco.mj_forward(model, data)
            places = data.geom_xpos[moving]
            camera.lookat[:] = (places.min(axis=0) + places.max(axis=0)) / 2
            if not pictures:
                off = np.linalg.norm(places - camera.lookat, axis=1) + model.geom_rbound[moving]
                camera.distance = _DISTANCE * float(off.max())
            renderer.update_scene(data, camera)
            draw_background(model, renderer.scene)
            pictures.append(Image.fromarray(renderer.render()))
    first, *others = chain(pictures)
    first.save(
        stored,
        "WEBP",
        save_all=True,
        append_images=others,
        duration=_MILLISECONDS,
        loop=0,
        quality=_QUALITY,
    )
    return stored.getvalue()
