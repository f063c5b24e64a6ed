"""Numbers, changes, counts and settings as text, for findings and reports."""

from collections.abc import Iterator, Mapping, Sequence

from contactlab.rendering.amounts import format_digits, format_interval, format_percent
from contactlab.schema.evidence import Setting
from contactlab.schema.finding import Finding, RunPair
from contactlab.shares import wilson_interval


def value_change(baseline: float, candidate: float, unit: str) -> str:
    """Return `0.1 -> 0.12 m (+20 %)`: two values and their relative change."""
    change = format_change(baseline, candidate, unit, 4)
    if baseline <= 0 or not abs(candidate / baseline) < 1e3:
        return change
    return f"{change} ({format_percent(candidate / baseline - 1, signed=True)})"


def format_change(before: float, after: float, unit: str, digits: int) -> str:
    """Return `1.74 -> 1.79 mm`: two values, small lengths and speeds in mm and mm/s.

    Values that look equal in these digits have ten.
    """
    small = 0.1  # m or m/s
    in_mm = unit in {"m", "m/s"} and 0 < max(abs(before), abs(after)) < small
    scale, name = (1e3, f"m{unit}") if in_mm else (1.0, unit)
    old, new = scale * before, scale * after
    texts = format_digits(old, digits), format_digits(new, digits)
    change = " -> ".join(texts) if texts[0] != texts[1] else f"{old:.10g} -> {new:.10g}"
    return change if name in {"", "1", "any"} else f"{change} {name}"


def share_with_interval(good: int, runs: int) -> str:
    """Return `80 % (58 to 92 %)`: a share of draws, and Wilson's interval of 95 %."""
    return with_interval(good / runs, *wilson_interval(good, runs))


def with_interval(share: float, low: float, high: float) -> str:
    """Return `80 % (58 to 92 %)`."""
    return f"{format_percent(share)} ({format_interval(low, high)})"


def out_of(count: int, total: int, noun: str = "run") -> str:
    """Return `2 of 6 runs`."""
    return f"{count:,} of {total:,} {noun}{'' if total == 1 else 's'}"


def plural(count: int, noun: str = "run") -> str:
    """Return `1 run` or `2 runs`."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def format_settings(values: Mapping[str, Setting]) -> str:
    """Return axis values as `cone=elliptic direction=45`."""
    return " ".join(f"{name}={_setting_text(value)}" for name, value in values.items())


def _setting_text(value: Setting) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return f"'{value}'" if isinstance(value, str) and " " in value else str(value)


def pair_values(finding: Finding, pair: RunPair) -> str:
    """Return the values of a pair: `stable -> tunneling`, or numbers and their ratio.

    A baseline that is an empty text is left out.
    """
    before, after = pair.baseline, pair.candidate
    if before is None and after is None:
        return ""
    if before == "":
        return _value_text(after)
    if before is None or after is None or isinstance(before, str) or isinstance(after, str):
        return f"{_value_text(before)} -> {_value_text(after)}"
    return value_change(before, after, finding.unit)


def _value_text(value: float | str | None) -> str:
    if value is None:
        return "none"
    return value if isinstance(value, str) else format_digits(value, 4)


def pair_location(pair: RunPair) -> str:
    """Return the axis values of a pair and the first digits of its run id."""
    run = (pair.candidate_run or pair.baseline_run or "")[:8]
    return f"{format_settings(pair.axes)} [{run}]".lstrip()


def pairs_in_words(finding: Finding) -> Iterator[str]:
    """Yield the worst pairs of a finding: `stable -> tunneling at cone=elliptic [0f3a...]`."""
    for pair in finding.worst:
        values = pair_values(finding, pair)
        yield f"{f'{values} ' if values else ''}at {pair_location(pair)}"


def passed_in_words(findings: Sequence[Finding]) -> str:
    """Return the number of passed findings, by kind; empty if none passed."""
    kinds = [finding.kind for finding in findings if finding.outcome == "passed"]
    counts = ", ".join(f"{kind} {kinds.count(kind)}" for kind in dict.fromkeys(kinds))
    return f"{plural(len(kinds), 'check')} passed ({counts})" if kinds else ""
