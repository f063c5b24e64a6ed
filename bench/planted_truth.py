"""How often the intervals of a fit have the settings that recordings were made with.

Run: python -m bench.planted_truth [FIRST CASES [sweeps]]

Half of the cases slide a puck, which tells friction only; the others toss it, which tells a little
of the time constant too. Settings are drawn by the number of the case. Runs are those of a plain
rollout, which takes an eighth of the time, unless `sweeps` asks for those that `fit` makes.
"""

import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from unittest import mock

import mujoco
import numpy as np
from mujoco import rollout
from tests.planted_recordings import MODEL, WIDTH, plant

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.parts import register_parts
from contactlab.run.sweep_request import SceneLoader
from contactlab.studies.fit.fitting import FitRequest, fit_settings
from contactlab.tasks.session import Session, Values

FREE = ("friction.slide", "solref.timeconst=0.005:0.06")


class PlainRuns:
    """The errors of a planted scene by MuJoCo's own rollout, in place of sweeps."""

    def __init__(self, scene: str) -> None:
        recorded = SceneLoader(Path()).open(scene).recorded
        assert recorded is not None
        self._recorded = recorded

    def __call__(self, name: str, settings: Sequence[Values], runs: Sequence[float]) -> Floats:
        """Return (points, runs) mean distances, in widths."""
        del name
        return np.array([self._errors(each, runs) for each in settings])

    def _errors(self, values: Values, runs: Sequence[float]) -> Floats:
        friction = values.get("friction.slide", 1.0)
        timeconst = values.get("solref.timeconst", 0.02)
        text = MODEL.format(friction=friction, timeconst=timeconst, height=0.03)
        model, motion = mujoco.MjModel.from_xml_string(text), self._recorded.recorded_motion(runs)
        step = model.opt.timestep
        starts = [np.array([0.0, *self._recorded.start_state(each)]) for each in runs]
        steps = round(max(map(self._recorded.duration_of, runs)) / step)
        found = rollout.rollout(model, mujoco.MjData(model), np.array(starts), nstep=steps)[0]
        assert found is not None
        states = np.concatenate([np.array(starts)[:, None], np.asarray(found)], axis=1)
        times = np.arange(steps + 1) * step
        errors = list[float]()
        for state, at, qpos in zip(states, motion.times, motion.qpos, strict=True):
            known = np.isfinite(at)
            here = [np.interp(at[known], times, state[:, 1 + axis]) for axis in range(3)]
            apart = np.linalg.norm(np.transpose(here) - qpos[known, :3], axis=1)
            errors.append(float(apart.mean()) / WIDTH)
        return np.array(errors)


def fitted(case: int, folder: Path, *, sweeps: bool) -> dict[str, tuple[bool, float, bool]]:
    """Return of each setting whether its interval has the truth, its ratio, and if identified."""
    rng = np.random.default_rng([case, 1])
    truth = [float(np.exp(rng.uniform(*np.log(each)))) for each in ((0.1, 0.6), (0.008, 0.03))]
    friction, timeconst = truth
    tossed = case % 2 == 1
    scene = plant(folder / "puck", friction, case, timeconst=timeconst, tossed=tossed, trials=12)
    request, session = FitRequest(scene, FREE, fitted=8), Session(folder / "fit")
    try:
        plain = mock.patch("contactlab.studies.fit.fitting._Trials.run", PlainRuns(scene))
    except SceneError as error:
        # Some pucks rock faster than frames show: their velocities are not those of the poses.
        print(case, error, flush=True)
        return {}
    with nullcontext() if sweeps else plain:
        report = fit_settings(request, session)
    found = dict[str, tuple[bool, float, bool]]()
    for true, each in zip(truth, report.settings, strict=True):
        assert each.interval is not None
        low, high = each.interval
        found[each.name] = low <= true <= high, high / low, each.identified
        print(case, each.name, f"{true:.4g} {each.value:.4g} {low:.4g} {high:.4g}", flush=True)
    return found


def main(first: int = 0, cases: int = 100, *, sweeps: bool = False) -> None:
    """Print how often each setting was within its interval."""
    kept = defaultdict[str, list[tuple[bool, float, bool]]](list)
    for case in range(first, first + cases):
        with tempfile.TemporaryDirectory() as folder:
            for name, each in fitted(case, Path(folder), sweeps=sweeps).items():
                kept[f"{('slid', 'tossed')[case % 2]} {name}"].append(each)
    for name, every in kept.items():
        within, ratios, known = map(np.array, zip(*every, strict=True))
        print(
            f"{name}: {within.sum()} of {len(every)} within, highest over lowest "
            f"{np.median(ratios):.3f}, identified in {known.sum()}"
        )


if __name__ == "__main__":
    register_parts()
    numbers = [int(each) for each in sys.argv[1:] if each.isdecimal()]
    main(*numbers, sweeps="sweeps" in sys.argv)
