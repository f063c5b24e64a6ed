"""Fits the time of each unit of counted work to measured times of models under many settings.

Run: python -m bench.step_work MODEL.xml ...

prints the coefficients of `contactlab/budget/step_work.py`, and how far counted ratios to
the model as written are from measured ones. Each model moves under sines of its controls; its
variants make the same steps from states along that motion. Each slice of a run is timed in five
turns of all variants, and its least time counts, since other programs only add.
"""

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from contactlab.budget.motion import INTEGRATION
from contactlab.budget.step_work import UNITS, StepWork
from contactlab.studies.search.configuration import Configuration
from contactlab.studies.search.search_space import find_integrators, propose_parameters

Floats = npt.NDArray[np.float64]
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)
STARTS, STEPS, SLICES, TURNS = 5, 40, 6, 5
SECONDS, MAX_STEPS = 1.0, 1500
"""Length of the motion [s], and most steps of it."""
FLAGS = {"energy": mujoco.mjtEnableBit.mjENBL_ENERGY, "fwdinv": mujoco.mjtEnableBit.mjENBL_FWDINV}
OTHERS: Sequence[Mapping[str, object]] = (
    {"solver": "PGS", "iterations": 100, "tolerance": 1e-15},
    {"solver": "CG", "iterations": 100, "tolerance": 1e-12, "island": False},
    {"noslip_iterations": 10},
    {"jacobian": "sparse", "island": False},
    {"solver": "Newton", "island": False, "jacobian": "dense"},
)
WEIGHT = 2.0
"""Weight of a difference to the model as written, against a time itself: searches need ratios."""
ROBUST, ROUNDS = 0.03, 6
"""Relative residual above which a row counts less, and rounds of weighted fits."""


@dataclass
class Variant:
    """A model with other settings, its counted work and its time per step [s]."""

    name: str
    model: mujoco.MjModel
    work: Floats = field(default_factory=lambda: np.zeros(len(UNITS)))
    seconds: float = 0.0


def variants_of(model: mujoco.MjModel) -> Iterator[Variant]:
    """Yield the model as written, and with other settings."""
    settings: list[Mapping[str, object]] = [{}]
    settings += [{"integrator": name} for name in find_integrators(model)[1:]]
    for each in propose_parameters(model):
        last = [*each.values[-1:], *each.step_sensitive[-1:]]
        settings += last if each.cost_falls else each.values
    for chosen in (*settings, *OTHERS):
        name = ", ".join(f"{key.partition('[')[0]} {value}" for key, value in chosen.items())
        yield Variant(name, Configuration(chosen).apply_to(model))
    for name, bit in FLAGS.items():
        made = Configuration({}).apply_to(model)
        made.opt.enableflags |= int(bit)
        yield Variant(name, made)


def moving_states(model: mujoco.MjModel) -> tuple[list[Floats], list[Floats]]:
    """Return states along a motion under sines, and the controls (STEPS, nu) that follow each."""
    data, generator = mujoco.MjData(model), np.random.default_rng(0)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    limited = model.actuator_ctrllimited.astype(bool)
    low = np.where(limited, model.actuator_ctrlrange[:, 0], -1.0)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], 1.0)
    steps = int(min(SECONDS / model.opt.timestep, MAX_STEPS))
    times = np.arange(steps + STEPS)[:, None] * model.opt.timestep
    phases = generator.uniform(0, 2 * np.pi, model.nu)
    controls = (low + high) / 2 + 0.35 * (high - low) * np.sin(3 * np.pi * times + phases)
    starts, following = list[Floats](), list[Floats]()
    chosen = set(np.linspace(0, steps - 1, STARTS).astype(int).tolist())
    for step in range(steps):
        if step in chosen:
            state = np.empty(mujoco.mj_stateSize(model, INTEGRATION))
            mujoco.mj_getState(model, data, state, INTEGRATION)
            starts.append(state)
            following.append(controls[step : step + STEPS])
        data.ctrl[:] = controls[step]
        mujoco.mj_step(model, data)
    return starts, following


def slice_seconds(model: mujoco.MjModel, starts: list[Floats], controls: list[Floats]) -> Floats:
    """Return the thread time of each slice of all runs, without their first steps [s]."""
    data, taken = mujoco.MjData(model), list[float]()
    ends = np.linspace(1, STEPS, SLICES + 1).astype(int).tolist()
    for start, rows in zip(starts, controls, strict=True):
        mujoco.mj_resetData(model, data)
        mujoco.mj_setState(model, data, start, INTEGRATION)
        for first, last in zip([0, *ends], ends, strict=False):
            begin = time.thread_time()
            for step in range(first, last):
                if model.nu:
                    mujoco.mj_setState(model, data, rows[step], CONTROL)
                mujoco.mj_step(model, data)
            if first:
                taken.append(time.thread_time() - begin)
    return np.array(taken)


def measured_variants(path: Path) -> list[Variant]:
    """Return the variants of a model, the one as written first, with work and times."""
    model = mujoco.MjModel.from_xml_path(str(path))
    starts, controls = moving_states(model)
    if not np.isfinite(starts).all():
        return []
    found = list(variants_of(model))
    least = [np.array(np.inf)] * len(found)
    for _ in range(TURNS):
        for place, one in enumerate(found):
            seconds = slice_seconds(one.model, starts, controls)
            least[place] = np.minimum(least[place], seconds)
    for one, seconds in zip(found, least, strict=True):
        work, data = StepWork(one.model), mujoco.MjData(one.model)
        for start, rows in zip(starts, controls, strict=True):
            mujoco.mj_resetData(one.model, data)
            mujoco.mj_setState(one.model, data, start, INTEGRATION)
            work.count_steps(data, STEPS, rows if one.model.nu else None, CONTROL)
        one.work, one.seconds = work.total / work.steps, float(seconds.sum()) / work.steps
    return found


def fit_units(groups: Sequence[Sequence[Variant]]) -> Floats:
    """Return the time of each unit [s]: the best for relative times and for their differences."""
    rows, values = list[Floats](), list[float]()
    for base, *others in groups:
        for one in (base, *others):
            rows.append(one.work / one.seconds)
            values.append(1.0)
        for one in others:
            rows.append(WEIGHT * (one.work - base.work) / base.seconds)
            values.append(WEIGHT * (one.seconds - base.seconds) / base.seconds)
    matrix, target = np.array(rows), np.array(values)
    weights, found = np.ones(len(target)), np.zeros(len(UNITS))
    for _ in range(ROUNDS):
        found, _ = nnls(matrix * weights[:, None], target * weights)
        residuals = np.abs(matrix @ found - target)
        weights = 1 / np.sqrt(np.maximum(residuals, ROBUST))
    return found


def main() -> None:
    """Measure all models, fit, and print."""
    groups = [found for path in sys.argv[1:] if (found := measured_variants(Path(path)))]
    units = fit_units(groups)
    for name, seconds in zip(UNITS, units, strict=True):
        print(f'    "{name}": {float(f"{1e9 * seconds:.3g}"):g},')
    off = [
        abs((one.work @ units) / (base.work @ units) / (one.seconds / base.seconds) - 1)
        for base, *others in groups
        for one in others
    ]
    half, most = np.quantile(off, [0.5, 0.9])
    print(f"{len(off)} ratios of {len(groups)} models: {half:.1%} off in half, {most:.1%} in 90 %")


if __name__ == "__main__":
    main()
