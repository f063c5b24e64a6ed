"""Recordings made by simulation, with known settings and the noise of sensors."""

from pathlib import Path

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats

MODEL = """<mujoco><option timestep="0.004" cone="elliptic"/>
<default><geom friction="{friction}" solref="{timeconst} 1"/></default><worldbody>
<geom name="floor" type="plane" size="3 3 .1"/>
<body name="puck" pos="0 0 {height}"><freejoint name="puck"/>
<geom name="puck" type="box" size=".06 .04 .03"/></body></worldbody></mujoco>"""
SCENE = """\
version: 1
title: t
description: d
duration: 1.0
subject: puck
pairs: [{{geoms: [floor, puck], slots: 4}}]
recording:
  {{file: motion.csv, run: trial, units: {{length: m, angle: rad, time: s}}, start: {start}}}
"""
PARTS = ("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")
NOISE = np.array([3e-4] * 3 + [2e-3] * 3 + [5e-3] * 3 + [0.02] * 3)
"""Of a good motion capture: positions [m], turns [rad], velocities [m/s], rates [rad/s]."""
TRIALS, WIDTH, _FRAMES = 18, 0.06, 40


def plant(
    folder: Path,
    friction: float,
    seed: int,
    *,
    timeconst: float = 0.02,
    tossed: bool = False,
    trials: int = TRIALS,
) -> str:
    """Write a scene of MuJoCo's defaults, with recordings of other settings, at 125 Hz.

    A puck slides from its first frame, or is tossed, and starts three frames before it can touch.
    """
    folder.mkdir()
    height = 0.18 if tossed else 0.03
    start = "{before_contact: 3}" if tossed else "{}"
    (folder / "scene.xml").write_text(MODEL.format(friction=1, timeconst=0.02, height=height))
    (folder / "scene.yaml").write_text(SCENE.format(start=start))
    text = MODEL.format(friction=friction, timeconst=timeconst, height=height)
    model = mujoco.MjModel.from_xml_string(text)
    names = ["trial", "time", *(f"puck.{part}" for part in PARTS)]
    rng, lines = np.random.default_rng(seed), [",".join(names)]
    spread = np.array([1, 1, 0, 2, 2, 3] if tossed else [1, 1, 0, 0, 0, 3])
    for trial in range(trials):
        data = mujoco.MjData(model)
        data.qvel[:] = rng.normal(size=6) * spread
        for frame in range(_FRAMES):
            state = _sensed(data, NOISE * rng.normal(size=12))
            lines.append(",".join(map(repr, [trial, frame / 125, *state.tolist()])))
            mujoco.mj_step(model, data, nstep=2)
    (folder / "motion.csv").write_text("\n".join(lines) + "\n")
    return f"{folder}/"


def _sensed(data: mujoco.MjData, noise: Floats) -> Floats:
    """Return (13,) a free body's position, orientation and velocities, off by noise (12,)."""
    qpos = data.qpos[:7].copy()
    qpos[:3] += noise[:3]
    mujoco.mju_quatIntegrate(qpos[3:], noise[3:6], 1.0)
    return np.concatenate([qpos, data.qvel[:6] + noise[6:]])
