"""Words and the table of servos."""

import math
from collections.abc import Iterator, Sequence

from contactlab.rendering.amounts import format_amount, format_digits
from contactlab.rendering.document import Block, Column, Sentence, table_of
from contactlab.schema.servo import Servo


def format_length(servo: Servo, amount: float | None) -> str:
    """Return a motion of a servo in mm or degrees."""
    least = 1e-6  # micrometers and microradians are rounding and friction
    if amount is None or abs(amount) < least:
        return "-" if amount is None else "0"
    if servo.unit == "m":
        return format_amount(abs(amount), "mm", digits=2)
    return f"{format_digits(math.degrees(abs(amount)), 2)} deg"


def servo_tables(servos: Sequence[Servo]) -> Iterator[Block]:
    """Yield the table of servos, that of the gains that the step holds, and their meaning."""
    yield table_of(
        ("servo", *(Column(name, "right") for name in _COLUMNS)),
        [_list_cells(servo) for servo in servos],
    )
    yield Sentence(
        "Sag under gravity at the start, and under the load at the end of the first phase."
    )
    if any(servo.held_body for servo in servos):
        yield Sentence("* It presses on a body that moves, which may be meant.")
    limited = [servo for servo in servos if not servo.holds or servo.largest_gain is not None]
    if limited:
        limits = ("gains up to", "stiffness up to", "damping up to", "armature from")
        yield table_of(
            ("servo", "step", *(Column(name, "right") for name in limits)),
            [_list_limits(servo) for servo in limited],
        )
        yield Sentence("Each alone; other gains as written.")
    if len(limited) < len(servos) and all(servo.holds for servo in servos):
        rest = "the others" if limited else "all servos"
        yield Sentence(f"The step holds {rest} with 100 times their gains.")


_COLUMNS = ("stiffness", "at its tip", "Hz", "ratio", "sag", "in task")


def _list_cells(servo: Servo) -> Sequence[str]:
    unit = "Nm/rad" if servo.unit == "rad" else "N/m"
    return (
        servo.name,
        f"{format_digits(servo.stiffness)} {unit}" if servo.stiffness else "none",
        format_amount(servo.tip_stiffness, "N/m", digits=2),
        format_amount(servo.frequency),
        format_amount(servo.damping_ratio),
        format_length(servo, servo.gravity_sag),
        format_length(servo, servo.task_sag) + "*" * bool(servo.held_body),
    )


def _list_limits(servo: Servo) -> Sequence[str]:
    angle = servo.unit == "rad"
    units = ("Nm/rad", "Nms/rad", "kg m^2") if angle else ("N/m", "Ns/m", "kg")
    limits = (servo.largest_stiffness, servo.largest_damping, servo.least_armature)
    return (
        servo.name,
        "holds" if servo.holds else "fails",
        "-" if servo.largest_gain is None else f"x{format_digits(servo.largest_gain, 2)}",
        *(
            "-" if limit is None else f"{format_digits(limit, 2)} {unit}"
            for limit, unit in zip(limits, units, strict=True)
        ),
    )
