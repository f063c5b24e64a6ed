"""What all checks mean together: verdict, exit code, one sentence, what to do next."""

from collections.abc import Iterator, Sequence

from contactlab.compare.sides import Side
from contactlab.compare.verdicts import NAMES
from contactlab.compare.wording import some
from contactlab.schema import Check, Verdict

FINE, GATE_FAILED, NOT_COMPARABLE = 0, 1, 3
_ABOUT_RUNS = {"runs", "labels", "metrics", "recommendation"}


def exit_code(checks: Sequence[Check]) -> int:
    """Return 0, 1 for a failed check, 3 where what must be comparable is not.

    What must be the same comes first: without it, no other check means anything.
    """
    skipped = [check for check in checks if _is_open(check)]
    if any(check.kind == "evidence" for check in skipped):
        return NOT_COMPARABLE
    if any(check.outcome == "failed" for check in checks):
        return GATE_FAILED
    return NOT_COMPARABLE if skipped else FINE


def overall(checks: Sequence[Check]) -> Verdict:
    """Return the verdict of a whole comparison."""
    if any(_is_open(check) and check.kind == "evidence" for check in checks):
        return "not comparable"
    failed = [check.verdict for check in checks if check.outcome == "failed"]
    if failed:
        return NAMES[max(NAMES.index(verdict) for verdict in failed)]
    if any(_is_open(check) for check in checks):
        return "not comparable"
    found = {check.verdict for check in checks if check.kind in _ABOUT_RUNS} - {"same"}
    found.discard("not comparable")
    if not found:
        return "same"
    return "better" if found == {"better"} else "changed"


def headline(checks: Sequence[Check]) -> str:
    """Return the whole comparison in one line."""
    verdict = overall(checks)
    failed = sum(check.outcome == "failed" for check in checks)
    skipped = sum(_is_open(check) for check in checks)
    if failed or skipped:
        fails = f"{failed} of {some(len(checks), 'check')} fail" if failed else ""
        open_ = f"{some(skipped, 'check')} cannot be made" if skipped else ""
        return f"{verdict}: {', '.join(part for part in (fails, open_) if part)}"
    changed = [f"{count} {name}" for name, count in _changed(checks)]
    if changed:
        return f"{verdict}: no check of {len(checks)} fails; {', '.join(changed)}"
    return f"{verdict}: no check of {len(checks)} fails"


def advice(checks: Sequence[Check], baseline: Side, candidate: Side) -> tuple[str, ...]:
    """Return the commands that lead on from here."""
    return tuple(_advice(checks, baseline, candidate))


def _advice(checks: Sequence[Check], baseline: Side, candidate: Side) -> Iterator[str]:
    order = ("failed", "warned", "noted")
    told = sorted((c for c in checks if c.outcome in order), key=lambda c: order.index(c.outcome))
    pair = next((pair for check in told for pair in check.worst if pair.candidate_run), None)
    if pair is not None:
        yield f"look closer: contactlab show {candidate.store.address} {pair.candidate_run}"
    failed = next((check for check in checks if check.outcome == "failed"), None)
    if failed is not None:
        yield (
            f"accept one: contactlab compare {baseline.store.address} {candidate.store.address} "
            f'--policy policy.yaml --accept "{failed.name}" --reason "..."'
        )
    if failed is not None or any(
        check.kind in _ABOUT_RUNS and check.outcome == "noted" for check in checks
    ):
        yield (
            "make the candidate the baseline: contactlab baseline update "
            f"{candidate.store.address} {baseline.store.address}"
        )


def _changed(checks: Sequence[Check]) -> Iterator[tuple[str, int]]:
    for name in ("better", "changed", "worse"):
        kinds = [check for check in checks if check.kind in _ABOUT_RUNS and check.verdict == name]
        if kinds:
            yield (name if name != "worse" else "worse within budget"), len(kinds)


def _is_open(check: Check) -> bool:
    return check.outcome == "skipped" and check.level == "gate"
