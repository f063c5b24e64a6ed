"""Words and the table of the loop of a policy."""

from collections.abc import Iterator

from contactlab.rendering.amounts import format_amount, format_digits
from contactlab.rendering.document import Block, Column, Sentence, table_of
from contactlab.schema.control_loop import ControlLoopReport, LoopMargin

_NAMES = {
    "rate": "rate of the controller",
    "delay": "delay",
    "gain": "gains, as a factor",
    "armature": "armature of all driven joints",
}


def loop_sentence(report: ControlLoopReport) -> str:
    """Return whether a loop holds, and its borders, in a sentence."""
    rate = format_frequency(report.rate)
    borders = {margin.name: margin for margin in report.margins}
    parts = [
        _border_text(borders[name])
        for name in ("rate", "delay", "gain", "armature")
        if name in borders and _is_told(borders[name], holds=report.holds)
    ]
    told = f": it holds {', '.join(parts)}" if parts else ""
    if report.holds:
        return f"the loop at {rate} holds{told}"
    return f"the loop at {rate} does not hold, first at joint {report.joint}{told}"


def _is_told(margin: LoopMargin, *, holds: bool) -> bool:
    if margin.border is None:
        return False
    return not holds or margin.border != margin.current or margin.name == "delay"


def _border_text(margin: LoopMargin) -> str:
    value = margin.border or 0.0
    match margin.name:
        case "rate":
            return f"from {format_frequency(value)}"
        case "delay":
            return f"up to a delay of {format_amount(value, 'ms')}"
        case "gain":
            return f"up to x{format_digits(value, 2)} of its gains"
        case "armature":
            return f"with an armature from {format_digits(value, 2)}"


def format_frequency(rate: float) -> str:
    """Return a rate in Hz or kHz."""
    return f"{format_digits(rate / 1e3)} kHz" if rate >= 1e3 else f"{format_digits(rate)} Hz"


def loop_blocks(report: ControlLoopReport) -> Iterator[Block]:
    """Yield the sentence of a loop, its modes, and the table of its margins."""
    yield Sentence(loop_sentence(report))
    growth = format_amount(report.growth)
    yield Sentence(
        f"fastest mode: joint {report.joint}, x{format_digits(report.eigenvalue or 0.0, 4)} a "
        f"period, {growth} 1/s; a small offset grows by {format_amount(report.simulated_growth)} "
        f"1/s in a run (up to {format_digits(report.allowed_growth, 2)} 1/s holds)"
    )
    rows = [
        (
            _NAMES[margin.name],
            format_amount(margin.current, margin.unit, digits=3),
            "from" if margin.holds_above else "up to",
            format_amount(margin.border, margin.unit, digits=3),
            format_amount(margin.linear, margin.unit, digits=3),
        )
        for margin in report.margins
    ]
    yield table_of(
        (
            "each alone",
            Column("now", "right"),
            "holds",
            Column("simulated", "right"),
            Column("linear", "right"),
        ),
        rows,
    )
