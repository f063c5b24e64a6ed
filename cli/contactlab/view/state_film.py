"""Writes films of configurations with contact forces, for a motion without a store."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import STICK, Floats
from contactlab.errors import OutputError, optional
from contactlab.view.drawn_motion import (
    BodyMotion,
    ContactForces,
    arrow_scale,
    joint_motion,
    scene_sphere,
)
from contactlab.view.drawn_shapes import body_poses, body_shapes

SIZE = (640, 480)
"""Width and height of a film in pixels."""
RATES = {".mp4": 25, ".gif": 20}
"""Frames per second of a film, by the ending of its file."""


@dataclass(frozen=True)
class Chapter:
    """A part of a film.

    Attributes:
        words: caption below it.
        states: (F, nstate) states of mjSTATE_INTEGRATION, one for each frame.
    """

    words: str
    states: Floats


def check_film(target: Path) -> None:
    """Check that a film can be written; raise an OutputError with the reason if not."""
    if target.suffix.lower() not in RATES:
        raise OutputError(f"cannot write {target}: end its name in {' or '.join(RATES)}")
    with optional("view", target.suffix):
        import contactlab.view.film  # noqa: F401, PLC0415 # pyright: ignore[reportUnusedImport]


def write_states(
    target: Path,
    model: mujoco.MjModel,
    chapters: Sequence[Chapter],
    around: int,
    *,
    size: tuple[int, int],
    rate: int,
) -> None:
    """Write a film of states, with the view around a body, each chapter with its words.

    It has a size in pixels and shows `rate` states per second.

    Raises:
        OutputError: the file's suffix is not a film's, or a required library is not installed.
        SceneError: there is no OpenGL to draw with.
    """
    check_film(target)
    from contactlab.view.film import (  # noqa: PLC0415 - an extra
        add_caption,
        draw_pictures,
        force_bar,
        write_gif,
        write_mp4,
    )

    qpos, motion = _states_motion(model, chapters, around)
    words = [word for each in chapters for word in repeat(each.words, len(each.states))]
    frames = draw_pictures(model, motion, dict(enumerate(qpos)), size)
    bar = None
    if len(motion.forces.frame):
        bar = force_bar(model, motion.stage, size, motion.scale)

    def pictures() -> Iterator[np.ndarray]:
        for picture, word in zip(frames, words, strict=True):
            yield add_caption(picture, [word], bar)

    write = write_mp4 if target.suffix.lower() == ".mp4" else write_gif
    write(target, pictures(), rate)


def _states_motion(
    model: mujoco.MjModel, chapters: Sequence[Chapter], around: int
) -> tuple[Floats, BodyMotion]:
    """Return (F, nq) configurations, and their drawn motion."""
    states = np.concatenate([each.states for each in chapters])
    data, qpos = mujoco.MjData(model), np.empty((len(states), model.nq))
    frames, points, forces = list[int](), list[Floats](), list[Floats]()
    spec = mujoco.mjtState.mjSTATE_INTEGRATION.value
    for frame, state in enumerate(states):
        mujoco.mj_setState(model, data, state, spec)
        mujoco.mj_forward(model, data)
        qpos[frame] = data.qpos
        for place in range(data.ncon):
            if data.contact[place].efc_address < 0:
                continue
            force = np.empty(6)
            mujoco.mj_contactForce(model, data, place, force)
            frames.append(frame)
            points.append(data.contact[place].pos.copy())
            forces.append(data.contact[place].frame.reshape(3, 3).T @ force[:3])
    contact_forces = ContactForces(
        frame=np.array(frames, np.intp),
        pair=np.zeros(len(frames), np.intp),
        mode=np.full(len(frames), STICK, np.int8),
        position=np.array(points).reshape(-1, 3),
        force=np.array(forces).reshape(-1, 3),
    )
    positions, rotations = body_poses(model, qpos)
    parts, moving = body_shapes(model), model.body_weldid != 0
    near = np.isin(np.arange(model.nbody), around)
    stage = scene_sphere(parts, near, positions[:1], rotations[:1], positions[0, around][None])
    view_radii = 4.0  # radii of the body that a film is around
    stage = stage._replace(radius=view_radii * stage.radius)
    scale, longest = arrow_scale(contact_forces.force, stage.radius)
    return qpos, BodyMotion(
        bodies=tuple(model.body(index).name for index in range(model.nbody)),
        moving=moving,
        shapes=parts,
        rows=np.arange(len(qpos)),
        time=np.arange(len(qpos), dtype=float),
        positions=positions,
        rotations=rotations,
        joints=joint_motion(model, qpos, np.zeros((len(qpos), model.nv))),
        pairs=("contacts",),
        forces=contact_forces,
        stage=stage,
        scale=scale,
        longest=longest,
    )
