"""The results of checks, and their findings.

A gate is a failure that a run of the model shows, or a body that cannot exist. A warning is a rule
of thumb of people who simulate contact with MuJoCo.
"""

from collections.abc import Iterator, Mapping, Sequence

from contactlab.judge.limits import find_exceeding, find_limited, in_words, limit_findings, worst_of
from contactlab.schema.check_report import CheckResult, CheckVerdict, Measure
from contactlab.schema.finding import Finding, Level

# Verdict of a check if a limit of some level is exceeded, the worst first.
_VERDICTS: Mapping[Level, CheckVerdict] = {"gate": "fail", "warn": "warning", "note": "pass"}


def check_result(
    name: str,
    question: str,
    measures: Sequence[Measure],
    notes: Sequence[str] = (),
    stores: Sequence[str] = (),
) -> CheckResult:
    """Return the result of a check: the verdict of its worst measure.

    A check that measures nothing does not apply, for the reason that its first note gives.
    """
    if not measures:
        reason, *notes = notes
        verdict: CheckVerdict = "not applicable"
    else:
        levels = {measure.level for measure in find_exceeding(measures)}
        worst: list[CheckVerdict] = [word for level, word in _VERDICTS.items() if level in levels]
        verdict = worst[0] if worst else "pass"
        groups = sorted(find_limited(measures), key=lambda group: not find_exceeding(group))
        reason = "; ".join(in_words(worst_of(group)) for group in groups)
    return CheckResult(
        name=name,
        question=question,
        verdict=verdict,
        reason=reason,
        measures=tuple(measures),
        notes=tuple(notes),
        stores=tuple(stores),
    )


def findings_of(result: CheckResult) -> Iterator[Finding]:
    """Yield the findings of a check: one for all limited measures of one name."""
    if result.verdict == "not applicable":
        yield Finding(
            name=result.name,
            kind=result.name,
            level="note",
            outcome="skipped",
            verdict="not applicable",
            judged=0,
            failing=0,
            message=result.reason,
        )
    yield from limit_findings(result.name, result.measures)
