"""Measures the servos of a model in its task, and tells which of them sag or are not held."""

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from contactlab.budget.motion import INTEGRATION, Motion
from contactlab.budget.windows import replay_motion
from contactlab.closed_loop.servos import measure_servos
from contactlab.rendering.amounts import format_amount, format_digits, format_percent
from contactlab.reporting.loop_words import loop_sentence
from contactlab.reporting.servo_words import format_length
from contactlab.schema.examination import Examination, Fact
from contactlab.schema.servo import Servo


def measure_task_servos(motion: Motion) -> tuple[Servo, ...]:
    """Return the servos of a model at the start of its task, and under the load of its rest.

    `motion` is the first phase; its first seed rests in the last fifth.
    """
    model, window = motion.model, 0.01  # between states that are looked at [s]
    run = replay_motion(motion, window, 1)
    late = np.flatnonzero(run.valid[0] & (run.begins >= 0.8 * motion.steps))
    start, *rests = [
        _forward_state(model, state) for state in (motion.starts[0], *run.starts[0, late])
    ]
    return measure_servos(model, start, rests)


def _forward_state(model: mujoco.MjModel, state: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, INTEGRATION)
    mujoco.mj_forward(model, data)
    return data


def judge_loops(report: Examination) -> Examination:
    """Return a report of servos or a loop alone with a verdict, if one does not hold."""
    lost = [fact.sentence for fact in list_unheld_servos(report.servos)]
    if report.loop is not None and not report.loop.holds:
        lost.append(loop_sentence(report.loop))
    for sentence in lost:
        first, *_ = sentence.split(";")
        update = {"verdict": "fails", "headline": f"fails: {first}"}
        return report.model_copy(update=update)
    return report


def list_unheld_servos(servos: Sequence[Servo]) -> Iterator[Fact]:
    """Yield the servos that the step does not hold, if there are any."""
    lost = [servo for servo in servos if not servo.holds]
    if lost:
        names = ", ".join(servo.name for servo in lost[:3])
        more = f" and {len(lost) - 3} more" if len(lost) > 3 else ""
        yield Fact(
            kind="servo",
            place=lost[0].name,
            value=lost[0].timestep,
            unit="s",
            sentence=f"a step of {format_amount(lost[0].timestep, 'ms')} with "
            f"{lost[0].integrator} does not hold servo {names}{more}: a small motion grows",
        )


def list_sagging_servos(servos: Sequence[Servo]) -> Iterator[Fact]:
    """Yield the servo that sags most, if that is much of its travel or of a held body."""
    sags = [sag for servo in servos for sag in _list_sags(servo)]
    if sags:
        servo, load, amount, share, of = max(sags, key=lambda sag: sag[3])
        sag = format_length(servo, amount)
        newton = "N m" if servo.unit == "rad" else "N"
        yield Fact(
            kind="servo",
            place=servo.name,
            value=abs(amount),
            unit=servo.unit,
            sentence=f"servo {servo.name} sags {sag} under {load} ({format_percent(share)} of "
            f"{of}): its stiffness is {format_digits(servo.stiffness)} {newton}/{servo.unit}",
        )


def _list_sags(servo: Servo) -> Iterator[tuple[Servo, str, float, float, str]]:
    # The load, the sag, its share, and the length that it is a share of.
    small = 0.05  # share of the travel or of a held body, up to which a target is met
    loads = [("gravity", servo.gravity_sag)]
    if not servo.held_body:  # a squeeze is no sag
        loads.append(("the load of the task", servo.task_sag))
    lengths = [("its travel", servo.travel)]
    if servo.unit == "m":
        lengths.append((servo.held_body, servo.held_size))
    for load, amount in loads:
        for of, length in lengths:
            if amount is not None and length and abs(amount) > small * length:
                yield servo, load, amount, abs(amount) / length, of
