"""The points of a front in plain loops of MuJoCo: their errors and times on unseen seeds.

Run: python -m bench.tune_front FOLDER ...

A folder is the output of `contactlab tune MODEL -o FOLDER`. Each point is built from the settings
of its report, or loaded if it was written. Errors are those of `bench/tune_error.py`, against the
model as written at the fine step and with the integrator of the report's reference; seeds are added
until their mean is known to 5 %, or for a minute. Times are the medians of CPU times of whole runs,
in turns, without the time that it takes to set inputs.
"""

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
from bench.tune_cost import motions_of
from bench.tune_error import Motion, Plain, away, go_on, impulses, over

from contactlab.budget.motion import INTEGRATION
from contactlab.parts import register_parts
from contactlab.schema.tune_report import REPORT, FrontPoint, TuneReport

WINDOW, SLACK = 0.04, 0.05
FIRST, BATCH, MOST_SEEDS, TIMED_SEEDS, TURNS = 1000, 8, 240, 3, 7
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
    spec = mujoco.MjSpec.from_file(report.model)
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


class Reference:
    """The reference motion of one seed of a phase: its velocities at each fine step."""

    def __init__(self, written: Plain, motion: Motion, seed: int, own: float) -> None:
        self.written, self.motion, self.own = written, motion, own
        self.rate = round(own / written.model.opt.timestep)
        self.steps = max(1, round(WINDOW / own)) * self.rate
        self.total = motion.steps * self.rate
        self.inputs = motion.inputs[seed].repeat(self.rate, axis=0)
        written.begin(motion.starts[seed])
        self.states, speeds = dict[int, np.ndarray](), list[np.ndarray]()
        for place in range(self.total + 1):
            if place % self.steps == 0:
                self.states[place] = written.state()
            speeds.append(written.velocities())
            if place < self.total:
                written.step(self.inputs[place], motion.spec)
        self.speeds = np.array(speeds)

    def shares_of(self, tuned: Plain) -> np.ndarray:
        """Return (B,) residual impulses of a model over real ones."""
        multiple = round(tuned.model.opt.timestep / self.written.model.opt.timestep)
        held = max(2, round(self.steps / multiple))
        slack = max(1, min(multiple, int(SLACK * held * multiple + 1e-6)))
        residual, real = np.zeros(self.speeds.shape[1]), np.zeros(self.speeds.shape[1])
        for begin, state in self.states.items():
            end = begin + held * multiple
            if begin + self.steps > self.total or end + multiple > self.total:
                continue
            tuned.begin(state)
            seen = list[np.ndarray]()
            for step, place in enumerate(range(begin, end + multiple, multiple), 1):
                rows = self.inputs[place : place + multiple]
                tuned.step(rows.mean(axis=0) if rows.shape[1] else rows[0], self.motion.spec)
                if step >= held - 1:
                    seen.append(tuned.velocities())
            fast = self.speeds[end - slack : end + slack + 1]
            slow = np.array(seen)
            slow = slow[1] + (slow - slow[1]) * slack / multiple
            apart = np.maximum(away(slow[1], fast), away(fast[slack], slow))
            residual += apart * self.steps / (held * multiple)
            way = self.speeds[begin : begin + self.steps + 1 : self.rate]
            real += impulses(self.written, way, self.own)
            if begin == 0:
                real += np.linalg.norm(self.speeds[0], axis=1)
        return over(residual, real)


class FrontErrors:
    """Errors of models on ever more seeds.

    Attributes:
        shares: by phase, (seeds, models, bodies) residual impulses over real ones.
    """

    def __init__(self, report: TuneReport, models: Sequence[mujoco.MjModel]) -> None:
        self._report, self._models = report, models
        written = mujoco.MjModel.from_xml_path(report.model)
        self._own = float(written.opt.timestep)
        apply_settings(written, {"integrator": report.reference_integrator})
        self._written = Plain(written, report.reference_step)
        go_on(self._written)
        self._tuned = [Plain(each, float(each.opt.timestep)) for each in models]
        names = [written.body(int(body)).name for body in self._written.bodies]
        observed = report.task.observed
        self._kept = [place for place, name in enumerate(names) if not observed or name in observed]
        self.shares = dict[str, list[np.ndarray]]()

    def add_seeds(self, seeds: Sequence[int]) -> None:
        """Measure more seeds."""
        task = self._report.task.model_copy(update={"seeds": tuple(seeds)})
        for motion in motions_of(self._report, task):
            for seed in range(motion.seeds):
                reference = Reference(self._written, motion, seed, self._own)
                found = np.array([reference.shares_of(each) for each in self._tuned])
                self.shares.setdefault(motion.name, []).append(found[:, self._kept])

    def means(self) -> tuple[list[float], list[float]]:
        """Return the error of each model in its worst body and phase, and its standard error."""
        worst, apart = np.zeros(len(self._models)), np.zeros(len(self._models))
        for found in map(np.array, self.shares.values()):
            mean, rows = found.mean(axis=0), np.arange(len(worst))
            body = mean.argmax(axis=1)
            spread = found.std(axis=0, ddof=1) / np.sqrt(len(found))
            larger = mean[rows, body] > worst
            worst = np.where(larger, mean[rows, body], worst)
            apart = np.where(larger, spread[rows, body], apart)
        rest = np.array([self._correct_reference(each) for each in self._models])
        return (rest * worst).tolist(), (rest * apart).tolist()

    def _correct_reference(self, model: mujoco.MjModel) -> float:
        multiple = round(model.opt.timestep / self._report.reference_step)
        both = (self._written.model.opt.integrator, model.opt.integrator)
        is_rk4 = mujoco.mjtIntegrator.mjINT_RK4 in both
        return 1.0 if is_rk4 or multiple < 2 else multiple / (multiple - 1)


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


def measure_front(folder: Path) -> None:
    """Print the claimed and the measured error and time of each point of a study."""
    report = TuneReport.model_validate_json((folder / REPORT).read_text())
    models = [build_point(report, point, folder) for point in report.front]
    written = mujoco.MjModel.from_xml_path(report.model)
    errors, apart = measure_errors(report, models)
    task = report.task.model_copy(update={"seeds": tuple(range(FIRST, FIRST + TIMED_SEEDS))})
    motions, own = motions_of(report, task), float(written.opt.timestep)
    times = time_runs(motions, [written, *models], own)[1:]
    right = {"error within 20 %": 0, "interval covers": 0, "time within 7 %": 0}
    for point, error, known, ratio in zip(report.front, errors, apart, times, strict=True):
        claimed, timed = point.error or np.nan, point.candidate.time_ratio
        shown = timed.ratio if timed else point.candidate.cost or np.nan
        low, high = point.error_low or 0.0, point.error_high or np.inf
        slack = 2 * known + 1e-3 * error  # motions without chance differ in their last digits
        covers = low - slack <= error <= high + slack
        right["error within 20 %"] += abs(error / claimed - 1) <= 0.2
        right["interval covers"] += covers
        right["time within 7 %"] += abs(ratio / shown - 1) <= 0.07
        print(
            f"{folder.name:10} {point.number} {point.name[:24]:24} error {claimed:9.4%} measured "
            f"{error:9.4%} +- {known / error:.0%} ({error / claimed - 1:+6.1%})"
            f"{'' if covers else ' OUTSIDE'}   time x{shown:.3f} measured x{ratio:.3f} "
            f"({ratio / shown - 1:+6.1%}){'' if timed else ' counted'}",
            flush=True,
        )
    count = len(report.front)
    counts = ", ".join(f"{name} {number} of {count}" for name, number in right.items())
    print(f"{folder.name}: {counts}", flush=True)


if __name__ == "__main__":
    register_parts()
    for word in sys.argv[1:]:
        measure_front(Path(word))
