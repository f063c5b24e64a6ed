"""Points by hand against the front of `tune`.

Run: python -m bench.tune_hand FOLDER ...

A folder is the output of `contactlab tune MODEL -o FOLDER`. The hand tries every usable step with
every integrator, each with one or two further changes: solver, iterations, tolerance, cone, matrix,
islands, sleep. Those that lie furthest beyond the front on a few seeds are measured again, with the
points of the front, on other seeds: the best of hundreds of noisy numbers is mostly noise. A point
lies beyond the front by the time that it saves against the straight line, in logarithms, through
the points of the front at its error.
"""

import itertools
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import bench.tune_front as front
import mujoco
import numpy as np
from bench.tune_cost import file_of, motions_of
from bench.tune_front import (
    FrontErrors,
    Settings,
    build_candidate,
    build_point,
    measure_errors,
    time_runs,
)

from contactlab.parts import register_parts
from contactlab.schema.tune_report import REPORT, TuneReport

FEW, FIRST_SEED, BEST, LONGEST = 4, 3000, 12, 0.04
STEPS = [digit * power for power in (1e-4, 1e-3, 1e-2) for digit in (1.0, 2.0, 2.5, 4.0, 5.0, 8.0)]
CHANGES: tuple[Settings, ...] = (
    {},
    {"solver": "Newton", "iterations": 3},
    {"solver": "CG"},
    {"solver": "CG", "iterations": 10},
    {"solver": "PGS", "iterations": 20},
    {"tolerance": 1e-4},
    {"cone": "elliptic"},
    {"cone": "pyramidal"},
    {"sleep": True, "island": True},
)


def list_candidates(report: TuneReport) -> Iterator[tuple[float, Settings]]:
    """Yield steps and settings; a change that leaves the model unchanged is left out."""
    model = mujoco.MjModel.from_xml_path(file_of(report.model))
    is_free = any("contact" in point.candidate.settings for point in report.front)
    free: Settings = {"contact": False} if is_free else {}
    fine, own = report.reference_step, float(model.opt.timestep)
    usable = [step for step in sorted({*STEPS, own}) if is_whole(step / fine) and step <= LONGEST]
    integrators = ("Euler", "implicitfast", "implicit", "RK4")
    changes = CHANGES[:1] if is_free or not model.ngeom else CHANGES
    for step, name in itertools.product(usable, integrators):
        if step >= 1.5 * fine:
            for change in changes:
                yield (
                    step,
                    {"island": False, "jacobian": "dense", "integrator": name, **free, **change},
                )


def is_whole(ratio: float) -> bool:
    """Return whether a ratio is a whole number, up to rounding."""
    return round(ratio) >= 1 and abs(ratio - round(ratio)) < 1e-6


def measure_gains(
    points: Sequence[tuple[float, float]], errors: Sequence[float], times: Sequence[float]
) -> list[float]:
    """Return the share of the time that candidates save against the front at their errors."""
    kept, best = list[tuple[float, float]](), math.inf
    for time, error in sorted(points):
        if error < best:
            kept.append((math.log(time), math.log(max(error, 1e-300))))
            best = error
    along = [-error for _, error in kept]
    gains = list[float]()
    for error, time in zip(errors, times, strict=True):
        place = -math.log(max(error, 1e-300))
        if not math.isfinite(error) or not along[0] <= place <= along[-1]:
            gains.append(-math.inf)
            continue
        line = float(np.interp(place, along, [time for time, _ in kept]))
        gains.append(1 - time / math.exp(line))
    return gains


def measure_hand(folder: Path) -> None:
    """Print the points by hand that lie furthest beyond the front of a study."""
    report = TuneReport.model_validate_json((folder / REPORT).read_text())
    points = [build_point(report, point, folder) for point in report.front]
    tried = list(list_candidates(report))
    models = [build_candidate(report, *each) for each in tried]
    few = FrontErrors(report, [*points, *models])
    few.add_seeds(range(FIRST_SEED, FIRST_SEED + FEW))
    errors, _ = few.means()
    worst = max(errors[: len(points)])
    near = [place for place, error in enumerate(errors[len(points) :]) if error <= 1.1 * worst]
    written = mujoco.MjModel.from_xml_path(file_of(report.model))
    task = report.task.model_copy(update={"seeds": tuple(range(FIRST_SEED, FIRST_SEED + FEW))})
    motions, own = motions_of(report, task), float(written.opt.timestep)
    front.TIMED_SEEDS, front.TURNS = 1, 2
    times = time_runs(motions, [written, *points, *(models[place] for place in near)], own)[1:]
    own_points = list(zip(times[: len(points)], errors, strict=False))
    chosen_errors = [errors[len(points) + place] for place in near]
    gains = measure_gains(own_points, chosen_errors, times[len(points) :])
    best = [near[rank] for rank in np.argsort(gains)[::-1][:BEST].tolist()]
    again = [*points, *(models[place] for place in best)]
    errors, apart = measure_errors(report, again, FIRST_SEED + FEW)
    front.TIMED_SEEDS, front.TURNS = 3, 7
    times = time_runs(motions, [written, *again], own)[1:]
    own_points = list(zip(times[: len(points)], errors, strict=False))
    gains = measure_gains(own_points, errors[len(points) :], times[len(points) :])
    print(f"{folder.name}: {len(tried)} points by hand", flush=True)
    for rank in np.argsort(gains)[::-1][:4].tolist():
        step, settings = tried[best[rank]]
        error, time = errors[len(points) + rank], times[len(points) + rank]
        known = apart[len(points) + rank] / error if error else 0.0
        changes = {name: value for name, value in settings.items() if name != "integrator"}
        print(
            f"  {gains[rank]:+.1%} beyond the front: {settings['integrator']} {1e3 * step:g} ms, "
            f"error {error:.3e} +- {known:.0%}, x{time:.3f} {changes}",
            flush=True,
        )


if __name__ == "__main__":
    register_parts()
    for word in sys.argv[1:]:
        measure_hand(Path(word))
