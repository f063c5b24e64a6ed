"""A budget as lines of text for 80 columns."""

import textwrap
from collections.abc import Iterator

import numpy as np

from contactlab.budget.readings import ErrorBudget, PhaseBudget, Reading
from contactlab.budget.verdict import Reason, Verdict, percent
from contactlab.printable import visible

_WIDTH = 80
_NAME, _SHARE, _BAR = 24, 6, 8
# Bars are logarithmic, from a tenth of a percent to ten times the real forces.
_LEAST, _DECADES = 1e-3, 4
_NOTHING = 1e-4
_HEADS = {
    "numerics": "what the numbers cost",
    "model": "how soft and regularised the model is",
    "effect": "what effects are worth",
    "unknown": "what nobody knows exactly",
}


def budget_lines(budget: ErrorBudget, verdict: Verdict) -> list[str]:
    """Return a verdict with its reasons, and a table of each phase."""
    lines = [f"{verdict.word} within {percent(verdict.within)}"]
    for reason in verdict.reasons:
        lines += _wrapped(f"{reason.sentence}{_where(reason)}")
    for phase in budget.phases:
        lines += ["", *_phase_lines(phase)]
    return [visible(line) for line in lines]


def _where(reason: Reason) -> str:
    place = "" if reason.place in reason.sentence else reason.place
    time = f"at {reason.time:.3g} s" if np.isfinite(reason.time) else ""
    return "".join(f", {part}" for part in (place, time) if part)


def _phase_lines(phase: PhaseBudget) -> Iterator[str]:
    seeds, span = len(phase.energy), phase.steps * phase.timestep
    cost = "cost" if any(row.price for row in phase.rows) else ""
    title = f"{phase.name}: " if phase.name else ""
    yield _cut(
        f"{title}{_count(seeds, 'seed')} of {span:.3g} s at {1e3 * phase.timestep:.3g} ms, "
        f"{_count(phase.windows, 'window')} of {1e3 * phase.window:.3g} ms, "
        f"{_count(len(phase.bodies), 'body', 'bodies')}"
    )
    yield _row("", "worst", "by seed", "", cost, "body, time")
    yield _reading_line(phase, phase.run)
    for kind, head in _HEADS.items():
        rows = [row for row in phase.rows if row.kind == kind]
        if rows:
            yield f"{head}:"
        yield from (_reading_line(phase, row) for row in rows)
    yield from _wrapped(_also(phase))


def _also(phase: PhaseBudget) -> str:
    check = (
        f", reference {percent(phase.check * phase.run.share)}" if np.isfinite(phase.check) else ""
    )
    excess = percent(float(phase.excess.max(initial=0)))
    return (
        f"energy {100 * phase.energy_share:+.2g} %; not judged: path excess {excess}, worst window "
        f"{percent(phase.peak)}{check}"
    )


def _reading_line(phase: PhaseBudget, reading: Reading) -> str:
    if not reading.exercised:
        return _row(f"  {reading.name}", "-", "", "", "", "not exercised")
    if np.isnan(reading.share):
        return _row(f"  {reading.name}", "-", "", "", "", "not measured")
    low, high = (_short(float(share)) for share in (reading.seeds.min(), reading.seeds.max()))
    spread = "" if low == high else f"{low.removesuffix(' %')} - {high.removesuffix(' %')}"
    time = f" {reading.time:.2f} s" if np.isfinite(reading.time) and reading.share > 0 else ""
    return _row(
        f"  {reading.name}",
        _short(reading.share),
        spread,
        _bar(reading.share),
        f"{reading.price.ratio:.2f}" if reading.price else "",
        f"{phase.bodies[reading.body]}{time}",
    )


def _short(share: float) -> str:
    """Return a share in at most two digits, which tables can hold."""
    if not _NOTHING <= share < np.inf:
        return "0 %" if share < _NOTHING else percent(share)
    return percent(share)


def _bar(share: float) -> str:
    if not np.isfinite(share):
        return "#" * _BAR
    if share <= _LEAST:
        return ""
    return "#" * min(_BAR, max(1, round(_BAR * np.log10(share / _LEAST) / _DECADES)))


def _row(name: str, share: str, spread: str, bar: str, cost: str, where: str) -> str:
    cells = f"{name:{_NAME}} {share:>{_SHARE}}  {spread:<11} {bar:<{_BAR}} {cost:>4}  {where}"
    return _cut(cells).rstrip()


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ")


def _cut(line: str) -> str:
    return line if len(line) <= _WIDTH else f"{line[: _WIDTH - 2].rstrip()} …"


def _count(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"
