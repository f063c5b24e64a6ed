"""Does the row of the step converge? Run: python -m bench.convergence [FOLDER].

FOLDER has gymnasium's models (gymnasium/envs/mujoco/assets); without one, what is installed is
used. For ant, half_cheetah, hopper and humanoid, driven by sines that all steps see alike, it
prints the share of the run, the mean over four seeds: by Euler and RK4 and by step, with the ratios
of halvings; by references of RK4 in place of the run's own integrator; and by twice the window and
twice the reference's steps. It exits with 1 where a ratio of Euler is not within 1.7 to 3, RK4 is
not below Euler up to 5 ms, or the integrators of references differ by more than a tenth.
"""

import sys
from dataclasses import replace
from itertools import pairwise
from unittest.mock import patch

import mujoco
import numpy as np
from bench.budget import assets

from contactlab.budget import Motion, Settings, error_budget, measuring
from contactlab.budget.motion import INTEGRATION

_MODELS = "ant", "half_cheetah", "hopper", "humanoid"
_SECONDS, _SEEDS, _HELD = 2.0, 4, 0.02
_STEPS = 0.01, 0.005, 0.0025, 0.00125
_EULER, _RK4 = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtIntegrator.mjINT_RK4)
_LEAST, _MOST, _APART = 1.7, 3.0, 0.1
_REFERENCE = measuring.build_reference_model
PLAIN = Settings(energy=False, places=False, excess=False)


def driven(model: mujoco.MjModel, step: float, integrator: int) -> Motion:
    """Return a motion under sines of .5 to 1.5 Hz, held for 20 ms, within 70 % of the ranges."""
    model.opt.timestep, model.opt.integrator = step, integrator
    data, count = mujoco.MjData(model), round(_SECONDS / step)
    start = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
    mujoco.mj_getState(model, data, start, INTEGRATION)
    low, high = model.actuator_ctrlrange.T
    random = np.random.default_rng(0)
    hertz, phase = random.uniform(0.5, 1.5, (_SEEDS, 1, model.nu)), random.uniform(0, 6, model.nu)
    times = np.floor(np.arange(count) * step / _HELD + 1e-9)[:, None] * _HELD
    wave = np.sin(2 * np.pi * hertz * times + phase)
    controls = (low + high) / 2 + 0.35 * (high - low) * wave
    return Motion(model, np.tile(start, (_SEEDS, 1)), controls)


def share(motion: Motion, settings: Settings = PLAIN) -> float:
    """Return the run's share in percent."""
    return 100 * error_budget([motion], rows=(), settings=settings).error


def smooth_reference(model: mujoco.MjModel, rate: int) -> mujoco.MjModel:
    """Return a reference with RK4 in place of the run's own integrator."""
    smooth = _REFERENCE(model, rate)
    smooth.opt.integrator = _RK4
    return smooth


def main() -> None:
    """Print the tables."""
    wrong = list[str]()
    for name in _MODELS:
        model = mujoco.MjModel.from_xml_path(str(assets() / f"{name}.xml"))
        euler = [share(driven(model, step, _EULER)) for step in _STEPS]
        rk4 = [share(driven(model, step, _RK4)) for step in _STEPS[:3]]
        ratios = [coarse / fine for coarse, fine in pairwise(euler)]
        motion = driven(model, _STEPS[1], _EULER)
        longer = share(motion, replace(PLAIN, window=0.08))
        finer = share(motion, replace(PLAIN, finer=8))
        with patch.object(measuring, "build_reference_model", smooth_reference):
            other = share(motion)
        print(f"{name}: Euler {' '.join(f'{x:.3g}' for x in euler)} %, ratios ", end="")
        print(f"{' '.join(f'{x:.2f}' for x in ratios)}; RK4 {' '.join(f'{x:.3g}' for x in rk4)} %")
        print(f"  at 5 ms: references of RK4 {other:.3g} %, twice as fine {finer:.3g} %; ", end="")
        print(f"windows of 80 ms {longer:.3g} %", flush=True)
        if not all(_LEAST <= ratio <= _MOST for ratio in ratios):
            wrong.append(f"{name}: ratios of Euler")
        if any(smooth >= plain for smooth, plain in zip(rk4[1:], euler[1:], strict=False)):
            wrong.append(f"{name}: RK4 is not below Euler")
        if abs(other / euler[1] - 1) > _APART:
            wrong.append(f"{name}: references of RK4 give {other:.3g} %")
    sys.exit("; ".join(wrong) or None)


if __name__ == "__main__":
    main()
