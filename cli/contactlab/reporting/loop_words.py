"""Words and the table of the loop of a policy."""

from collections.abc import Iterator, Sequence

from contactlab.rendering.amounts import format_amount, format_digits
from contactlab.rendering.document import Block, Column, Sentence, table_of
from contactlab.schema.control_loop import ControlLoopReport

_NAMES = {
    "rate": "rate",
    "delay": "delay",
    "gain": "gain factor",
    "armature": "armature",
}


def loop_sentence(report: ControlLoopReport) -> str:
    """Return whether a loop holds, and its borders, in a sentence."""
    rate, borders = format_frequency(report.rate), {one.name: one for one in report.margins}
    found_borders = {
        name: margin.border for name, margin in borders.items() if margin.border is not None
    }
    unit = borders["armature"].unit if "armature" in borders else ""
    words = {
        "rate": "{} of at least " + format_frequency(found_borders.get("rate", 0.0)),
        "delay": "{} of at most " + format_amount(found_borders.get("delay"), "ms"),
        "gain": "{} of at most x" + format_digits(found_borders.get("gain", 0.0), 2),
        "armature": "{} of at least "
        + format_amount(found_borders.get("armature"), unit, digits=2),
    }
    nouns = {"rate": "a rate", "delay": "a delay", "gain": "gains", "armature": "an armature"}
    parts = [words[name].format(nouns[name]) for name in words if name in found_borders]
    if report.holds:
        border_text = (
            f"; each alone, {_join_parts(parts, 'and')} would hold it too" if parts else ""
        )
        return f"the loop at {rate} holds{border_text}"
    safe = {name: margin.doubled for name, margin in borders.items() if margin.doubled}
    border_text = f"; {_join_parts(parts, 'or')} holds it"
    if len(safe) == 2:
        border_text += (
            f", and with {format_frequency(safe['rate'])} or an armature of "
            f"{format_amount(safe['armature'], unit, digits=2)} it would hold at twice the "
            "gains, too"
        )
    inside = "; so do position servos of the model with the same gains (--apply loop-servos)"
    return (
        f"the loop at {rate} does not hold joint {report.joint}{border_text if parts else ''}"
        f"{inside if report.inside else ''}"
    )


def _join_parts(parts: Sequence[str], word: str) -> str:
    *first, last = parts
    return f"{', '.join(first)} {word} {last}" if first else last


def format_frequency(rate: float) -> str:
    """Return a rate in Hz or kHz."""
    return f"{format_digits(rate / 1e3)} kHz" if rate >= 1e3 else f"{format_digits(rate)} Hz"


def loop_blocks(report: ControlLoopReport) -> Iterator[Block]:
    """Yield the sentence of a loop, its modes, and the table of its margins."""
    yield Sentence(loop_sentence(report))
    growth, small = format_amount(report.growth), "does not stay small in a run"
    if report.simulated_growth is not None:
        small = f"grows by {format_amount(report.simulated_growth)} 1/s in a run"
    yield Sentence(
        f"fastest mode: joint {report.joint}, x{format_digits(report.eigenvalue or 0.0, 4)} a "
        f"period, {growth} 1/s; a small offset {small} (up to "
        f"{format_digits(report.allowed_growth, 2)} 1/s holds)"
    )
    has_doubled = any(margin.doubled for margin in report.margins)
    rows = [
        (
            _NAMES[margin.name],
            format_amount(margin.current, margin.unit, digits=3),
            "from" if margin.holds_above else "up to",
            *(
                format_amount(value, margin.unit, digits=3)
                for value in (margin.border, margin.linear, margin.doubled)[: 2 + has_doubled]
            ),
        )
        for margin in report.margins
    ]
    heads = ("now", "holds", "simulated", "linear", "twice the gains")[: 4 + has_doubled]
    yield table_of(
        ("each alone", *(Column(head, "right") if head != "holds" else head for head in heads)),
        rows,
    )
