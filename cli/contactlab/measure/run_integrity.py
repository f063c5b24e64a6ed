"""Labels of runs that are not valid simulations: clock, numbers, length; and of good runs."""

import re
from collections.abc import Sequence

import numpy as np

from contactlab.measure.context import Context, energy, first_step, runs_where, squares_from
from contactlab.measure.entries import (
    LABELS,
    Label,
    MeasuredRuns,
    Onset,
    OnsetIterator,
    label,
)

LABELS.add(
    Label(
        "crashed",
        "The process that simulated the run died.",
        "void",
        rank=5,
        advice="run it alone: contactlab verify STORE RUN; then a newer MuJoCo, with --mujoco",
        letter="1",
        colour="#261f25",
    )
)
LABELS.add(
    Label(
        "timeout",
        "The run took longer than its time limit.",
        "void",
        rank=4,
        advice="a shorter run, or a longer `timeout` in the sweep",
        letter="2",
        colour="#82857e",
    )
)
STABLE = LABELS.add(
    Label(
        "stable",
        "No other label applies.",
        "good",
        advice="nothing",
        colour="#dbe5de",
    )
)
_ACCEPTED, _NOTED = "Accepted: ", "Note: "


def stable_reason(accepted: str | None, noted: Sequence[str] = ()) -> str:
    """Return the reason of a stable run, with its accepted overlap and its notes in words."""
    overlap = [f"{_ACCEPTED}{accepted}."] if accepted else []
    return " ".join((STABLE.meaning, *overlap, *(f"{_NOTED}{note}." for note in noted)))


def find_accepted(reason: str) -> str:
    """Return the accepted overlap that the reason of a run has; empty without one."""
    return next(iter(_find_remarks(reason, _ACCEPTED)), "")


def find_notes(reason: str) -> list[str]:
    """Return the notes that the reason of a stable run has."""
    return _find_remarks(reason, _NOTED)


def _find_remarks(reason: str, kind: str) -> list[str]:
    if not reason.startswith(STABLE.meaning):
        return []
    remarks = re.split(f" (?={_ACCEPTED}|{_NOTED})", reason)[1:]
    return [one.removeprefix(kind).removesuffix(".") for one in remarks if one.startswith(kind)]


_MEMORY_WARNINGS = {"contactfull", "cnstrfull"}  # warnings of memory for contacts and constraints


@label(
    "void",
    rank=3,
    letter="3",
    colour="#363636",
    advice="read the reason: it names the refused input and the correction",
    traits=("no impact",),
)
def invalid(runs: MeasuredRuns) -> OnsetIterator:
    """The run cannot be simulated as requested, or recorded no step."""
    trace, setup = runs.context.trace, runs.context.setup
    for run in range(trace.runs):
        for name, value in (("timestep", trace.timestep[run]), ("duration", setup.duration[run])):
            if not value > 0:
                yield run, Onset(f"{name} {value:g} s is not positive", 0)
        if trace.steps == 0:
            yield run, Onset("no step was recorded", 0)


@label(
    "void",
    rank=2,
    letter="4",
    colour="#a29f95",
    advice="give <size memory> more, or fewer geoms that collide",
)
def buffer_overflow(runs: MeasuredRuns) -> OnsetIterator:
    """The engine dropped contacts or constraints, because a buffer was too small for them."""
    for run, counts in enumerate(runs.context.trace.warnings):
        if full := _MEMORY_WARNINGS & counts.keys():
            reason = f"too small: {', '.join(sorted(full))}; give the engine more memory"
            yield run, Onset(reason, _last_step(runs.context))


@label(
    "void",
    rank=1,
    letter="D",
    colour="#f7015c",
    advice="a shorter timestep; then look for light bodies on stiff joints or strong motors",
    traits=("no impact",),
)
def diverged(runs: MeasuredRuns) -> OnsetIterator:
    """The simulation failed: a warning, a wrong number, clock or quaternion, or an early end."""
    signs: dict[int, list[Onset]] = {}
    for check in (
        _find_warnings,
        _find_early_ends,
        _find_non_finite,
        _find_clock_errors,
        _find_quaternion_errors,
    ):
        for run, onset in check(runs):
            signs.setdefault(run, []).append(onset)
    for run, run_signs in signs.items():
        reason = "; ".join(sign.reason for sign in run_signs)
        yield run, Onset(reason, min(sign.step for sign in run_signs))


def _find_warnings(runs: MeasuredRuns) -> OnsetIterator:
    for run, run_warnings in enumerate(runs.context.trace.warnings):
        counts = {
            name: count for name, count in run_warnings.items() if name not in _MEMORY_WARNINGS
        }
        raised = [f"{name} x{count}" for name, count in counts.items() if count > 0]
        if raised:
            yield run, Onset(f"engine warnings: {', '.join(raised)}", _last_step(runs.context))


def _find_early_ends(runs: MeasuredRuns) -> OnsetIterator:
    trace = runs.context.trace
    if trace.steps < trace.steps_asked:
        reason = f"stopped after {trace.steps} of {trace.steps_asked} steps"
        for run in range(trace.runs):
            yield run, Onset(reason, _last_step(runs.context))


def _find_non_finite(runs: MeasuredRuns) -> OnsetIterator:
    trace = runs.context.trace
    checked = {"qpos": trace.qpos, "qvel": trace.qvel}
    if trace.has_energy:
        checked["energy"] = energy(runs.context)[:, :, None]
    for name, values in checked.items():
        # A sum is finite only if all of its numbers are; the step is looked up only otherwise.
        for run in runs_where(~np.isfinite(values.sum(axis=(1, 2)))):
            bad = ~np.isfinite(values[run]).all(axis=1)
            step = first_step(bad) if name == "energy" else max(first_step(bad) - 1, 0)
            yield run, Onset(f"{name} is not finite", step)


def _find_clock_errors(runs: MeasuredRuns) -> OnsetIterator:
    trace, limit = runs.context.trace, 1e-9  # share of a timestep; rounding is 1000 times less
    if trace.steps == 0:
        return
    ticks = np.diff(trace.time, axis=1)
    rounding = 4 * np.finfo(np.float64).eps * np.abs(trace.time).max(axis=1)
    slack = limit * trace.timestep + rounding
    low, high = trace.timestep - slack, trace.timestep + slack
    regular = (ticks.min(axis=1) >= low) & (ticks.max(axis=1) <= high)
    for run in runs_where(~regular):
        step = first_step(~((ticks[run] >= low[run]) & (ticks[run] <= high[run])))
        reason = f"the clock moved by {ticks[run, step]:.3g} s in a step of "
        yield run, Onset(f"{reason}{trace.timestep[run]:.3g} s", step)


def _find_quaternion_errors(runs: MeasuredRuns) -> OnsetIterator:
    limit = 1e-3  # off unit norm; the engine keeps 1e-16
    low, high = (1 - limit) ** 2, (1 + limit) ** 2
    starts = runs.context.setup.quaternions
    squares = squares_from(runs.context.trace.qpos, starts, 4)
    unit = (squares.min(axis=2) >= low) & (squares.max(axis=2) <= high)
    for place, run in np.argwhere(~unit).tolist():
        square = squares[place, run]
        if np.isfinite(square).all():
            state = first_step((square < low) | (square > high))
            norm = f"{np.sqrt(square[state]):.4g}"
            reason = f"the quaternion at qpos {starts[place]} has norm {norm}"
            yield run, Onset(reason, max(state - 1, 0))


def _last_step(context: Context) -> int:
    return max(context.trace.steps - 1, 0)
