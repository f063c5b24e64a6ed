"""The points of a front in plain loops of MuJoCo: their errors and times on unseen seeds.

Run: python -m bench.tune_front [--errors | --times] FOLDER ...

A folder is the output of `contactlab tune MODEL -o FOLDER`. `--errors` alone may run on a busy
machine, `--times` alone may not. Each point is built from the settings of its report, or loaded if
it was written. Errors are those of `bench/tune_error.py`. Seeds are added until their mean is known
to 5 %, or for a minute. Times are the medians of CPU times of whole runs, in turns, without the
time that it takes to set inputs.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
from bench.tune_cost import file_of, motions_of
from bench.tune_error import (
    Motion,
    Plain,
    build_references,
    measure_phase,
    own_shares,
)

from contactlab.budget.motion import INTEGRATION
from contactlab.parts import register_parts
from contactlab.schema.tune_report import REPORT, FrontPoint, TuneReport

FIRST, BATCH, MOST_SEEDS, TIMED_SEEDS, TURNS = 1000, 8, 240, 3, 7
ERROR_TOLERANCE, TIME_TOLERANCE = 0.2, 0.07
PRECISION, SECONDS = 0.05, 60.0
"""Standard error of means that is wanted, as a share; CPU time of a model's errors at most [s]."""
ENUMS = {
    "integrator": (mujoco.mjtIntegrator, "mjINT_"),
    "solver": (mujoco.mjtSolver, "mjSOL_"),
    "cone": (mujoco.mjtCone, "mjCONE_"),
    "jacobian": (mujoco.mjtJacobian, "mjJAC_"),
}


Settings = Mapping[str, object]


def build_point(report: TuneReport, point: FrontPoint, folder: Path) -> mujoco.MjModel:
    """Return the model of a point, from its file or from its settings."""
    if point.file:
        return mujoco.MjModel.from_xml_path(str(folder / point.file))
    one = point.candidate
    return build_candidate(report, one.timestep, one.settings, removes_unused=one.removes_unused)


def build_candidate(
    report: TuneReport, step: float, settings: Settings, *, removes_unused: bool = True
) -> mujoco.MjModel:
    """Return the model of a candidate, by default without provably unused collisions."""
    spec = mujoco.MjSpec.from_file(file_of(report.model))
    if removes_unused:
        for name in report.masked:
            geom = spec.geom(name)
            geom.contype = geom.conaffinity = 0
        for first, second in report.excluded:
            spec.add_exclude(bodyname1=first, bodyname2=second)
    model = spec.compile()
    apply_settings(model, settings)
    model.opt.timestep = step
    return model


def apply_settings(model: mujoco.MjModel, settings: Mapping[str, object]) -> None:
    """Write settings of a report into a compiled model."""
    for name, value in settings.items():
        if name.startswith("geom_condim["):
            model.geom(name[12:-1]).condim = int(str(value))
        elif name in ENUMS:
            enum, prefix = ENUMS[name]
            setattr(model.opt, name, getattr(enum, prefix + str(value).upper()))
        elif isinstance(value, bool):
            set_flag(model, name, on=value)
        else:
            setattr(model.opt, name, value)


def set_flag(model: mujoco.MjModel, name: str, *, on: bool) -> None:
    """Turn a flag on or off."""
    known = hasattr(mujoco.mjtEnableBit, "mjENBL_" + name.upper())
    enum = mujoco.mjtEnableBit if known else mujoco.mjtDisableBit
    bit = int(getattr(enum, ("mjENBL_" if known else "mjDSBL_") + name.upper()))
    field = "enableflags" if known else "disableflags"
    bits = int(getattr(model.opt, field))
    setattr(model.opt, field, bits | bit if on is known else bits & ~bit)


class FrontErrors:
    """Errors of models on ever more seeds.

    Attributes:
        shares: by phase, by seed and model, (2, bodies) residual impulses over real ones.
    """

    def __init__(self, report: TuneReport, models: Sequence[mujoco.MjModel]) -> None:
        self._report = report
        written = mujoco.MjModel.from_xml_path(file_of(report.model))
        self._own = float(written.opt.timestep)
        self._tuned = [Plain(each, float(each.opt.timestep)) for each in models]
        self._references = [build_references(written, each) for each in models]
        names = [written.body(int(body)).name for body in self._tuned[0].bodies]
        observed = report.task.observed
        self._kept = [place for place, name in enumerate(names) if not observed or name in observed]
        self.shares = dict[str, list[np.ndarray]]()

    def add_seeds(self, seeds: Sequence[int]) -> None:
        """Measure more seeds."""
        task = self._report.task.model_copy(update={"seeds": tuple(seeds)})
        for motion in motions_of(self._report, task):
            for seed in range(motion.seeds):
                found = np.array(
                    [
                        own_shares(tuned, references, motion, seed, self._own)
                        for tuned, references in zip(self._tuned, self._references, strict=True)
                    ]
                )
                self.shares.setdefault(motion.name, []).append(found[..., self._kept])

    def means(self) -> tuple[list[float], list[float]]:
        """Return the error of each model in its worst body and phase, and its standard error."""
        worst, apart = np.zeros(len(self._tuned)), np.zeros(len(self._tuned))
        for found in map(np.array, self.shares.values()):
            for place in range(len(worst)):
                mean, spread = measure_phase(found[:, place])
                body = int(mean.argmax())
                if mean[body] > worst[place]:
                    worst[place], apart[place] = mean[body], spread[body]
        return worst.tolist(), apart.tolist()


def measure_errors(
    report: TuneReport, models: Sequence[mujoco.MjModel], first: int = FIRST
) -> tuple[list[float], list[float]]:
    """Return the errors of models, and their standard errors, on as many seeds as these need."""
    errors, begin = FrontErrors(report, models), time.process_time()
    for seed in range(first, first + MOST_SEEDS, BATCH):
        errors.add_seeds(range(seed, seed + BATCH))
        pairs = zip(*errors.means(), strict=True)
        known = all(one <= PRECISION * mean for mean, one in pairs)
        if known or time.process_time() - begin > SECONDS:
            break
    return errors.means()


def time_runs(
    motions: Sequence[Motion], models: Sequence[mujoco.MjModel], own: float
) -> list[float]:
    """Return the CPU time of each model over that of the first: medians over turns.

    In a turn each model runs before and after the others, from a first model that changes.
    """
    datas = [mujoco.MjData(model) for model in models]
    spent = np.zeros((TURNS + 1, len(models)))
    for turn in range(TURNS + 1):
        order = np.roll(np.arange(len(models)), turn).tolist()
        for place in (*order, *order[::-1]):
            spent[turn, place] += sum(
                run_once(models[place], datas[place], motion, seed, own)
                for motion in motions
                for seed in range(TIMED_SEEDS)
            )
    # The first turn loads memory.
    ratios = spent[1:] / spent[1:, :1]
    return [median(each) for each in ratios.T.tolist()]


def run_once(
    model: mujoco.MjModel, data: mujoco.MjData, motion: Motion, seed: int, own: float
) -> float:
    """Return the CPU time of a run per simulated second, without that of setting its inputs."""
    step = float(model.opt.timestep)
    steps, rows = round(motion.steps * own / step), motion.inputs[seed]
    places = np.minimum((np.arange(steps) * step / own + 1e-6).astype(int), motion.steps - 1)
    mujoco.mj_resetData(model, data)
    mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
    begin = time.thread_time()
    for place in places:
        if rows.shape[1]:
            mujoco.mj_setState(model, data, rows[place], motion.spec)
        mujoco.mj_step(model, data)
    taken = time.thread_time() - begin
    if rows.shape[1]:
        begin = time.thread_time()
        for place in places:
            mujoco.mj_setState(model, data, rows[place], motion.spec)
        taken -= time.thread_time() - begin
    return taken / (steps * step)


def measure_front(folder: Path, *, errors: bool = True, times: bool = True) -> None:
    """Print the claimed and the measured errors and times of each point of a study."""
    report = TuneReport.model_validate_json((folder / REPORT).read_text())
    models = [build_point(report, point, folder) for point in report.front]
    if errors:
        compare_errors(folder.name, report, models)
    if times:
        compare_times(folder.name, report, models)


def compare_errors(name: str, report: TuneReport, models: Sequence[mujoco.MjModel]) -> None:
    """Print the claimed and the measured error of each point."""
    close = covered = 0
    for point, error, known in zip(report.front, *measure_errors(report, models), strict=True):
        claimed = point.error or np.nan
        low, high = point.error_low or 0.0, point.error_high or np.inf
        slack = 2 * known + 1e-3 * error  # motions without chance differ in their last digits
        covers = low - slack <= error <= high + slack
        close += abs(error / claimed - 1) <= ERROR_TOLERANCE
        covered += covers
        print(
            f"{name:10} {name_point(point):40} error {claimed:9.4%} ({low:.4%} to {high:.4%}), "
            f"measured {error:9.4%} +- {known / error:.0%} ({error / claimed - 1:+6.1%})"
            f"{'' if covers else ' OUTSIDE'}",
            flush=True,
        )
    count = len(report.front)
    print(f"{name}: within 20 % {close} of {count}, intervals agree {covered} of {count}")


def compare_times(name: str, report: TuneReport, models: Sequence[mujoco.MjModel]) -> None:
    """Print the claimed and the measured time ratio of each point."""
    written = mujoco.MjModel.from_xml_path(file_of(report.model))
    task = report.task.model_copy(update={"seeds": tuple(range(FIRST, FIRST + TIMED_SEEDS))})
    motions, own = motions_of(report, task), float(written.opt.timestep)
    close = 0
    for point, ratio in zip(
        report.front, time_runs(motions, [written, *models], own)[1:], strict=True
    ):
        timed = point.candidate.time_ratio
        shown = timed.ratio if timed else point.candidate.cost or np.nan
        shown = 1.0 if "as written" in point.marks else shown
        close += abs(ratio / shown - 1) <= TIME_TOLERANCE
        print(
            f"{name:10} {name_point(point):40} time x{shown:.3f}, measured x{ratio:.3f} "
            f"({ratio / shown - 1:+6.1%}){'' if timed else ' counted'}",
            flush=True,
        )
    print(f"{name}: time within 7 % {close} of {len(report.front)}", flush=True)


def name_point(point: FrontPoint) -> str:
    """Return the number, name and marks of a point."""
    return ", ".join((f"{point.number} {point.name}", *point.marks))


if __name__ == "__main__":
    register_parts()
    chosen = sys.argv[1:]
    for word in chosen:
        if not word.startswith("--"):
            measure_front(
                Path(word), errors="--times" not in chosen, times="--errors" not in chosen
            )
