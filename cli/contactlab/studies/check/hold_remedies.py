"""What practice does about a hold that chatters or creeps, tried on the model itself."""

from collections.abc import Callable, Iterator, Sequence

from contactlab.schema import Change, Measure
from contactlab.studies.check.bench import Bench, Tried, Values
from contactlab.studies.check.findings import missed
from contactlab.studies.check.lines import change, written
from contactlab.studies.check.target import Target

STORE = "hold_remedies"
_CHATTER = {"mode_switches"}
_LOST = "steps_lost"
_HARD: dict[str, object] = {"solimp": (0.99, 0.999, 0.001, 0.5, 2.0)}
_SHARES = (0.5, 0.25)
_FIRM: dict[str, object] = {"cone": "elliptic", "impratio": 10.0}
_FIRMEST: dict[str, object] = {**_FIRM, "solref": (0.005, 1.0)}


def mend(
    bench: Bench, measures: Sequence[Measure], measured: Callable[[Tried], Sequence[Measure]]
) -> list[Change]:
    """Try what should mend the measures that miss their limits, and say what each came to.

    Args:
        bench: runs the model.
        measures: of the model as it is.
        measured: gives the same measures of another run.

    Returns:
        The changes that were tried, those that cure first.
    """
    failed = {each.name for each in missed(measures)}
    rows = list(_remedies(bench.target, failed))
    if not rows:
        return []
    runs = bench.run(STORE, "What should mend the hold", rows, checks="none")
    tried = [_outcome(bench.target, failed, each, measured(each)) for each in runs]
    return sorted(tried, key=lambda each: not each.cures)


def verdict_on_chatter(changes: Sequence[Change]) -> Iterator[str]:
    """Yield which of practice's two remedies against chatter cured it, if they were tried."""
    hard = [each for each in changes if each.settings.keys() == _HARD.keys()]
    shorter = [each for each in changes if each.settings.keys() == {"timestep"}]
    if not hard:
        return
    longest = max((_timestep(each) for each in shorter if each.cures), default=None)
    yield (
        f"solimp {written(_HARD['solimp'])} at the same timestep "
        f"{'cures' if hard[0].cures else 'does not cure'} the chatter, a smaller timestep "
        + ("does not" if longest is None else f"does, {longest * 1e3:g} ms")
    )


def _timestep(change: Change) -> float:
    return float(str(change.settings["timestep"]))


def _remedies(target: Target, failed: set[str]) -> Iterator[Values]:
    """Yield settings: against chatter an impedance or a smaller timestep; else firmer friction.

    A run that does not get to its end may with a smaller timestep.
    """
    if failed & _CHATTER:
        yield _HARD
    if failed & {*_CHATTER, _LOST}:
        shorter = [target.resolved.timestep * share for share in _SHARES]
        yield from ({"timestep": each} for each in shorter if target.fits(each, target.duration))
    if failed - {*_CHATTER, _LOST}:
        yield _FIRM
        yield _FIRMEST


def _outcome(target: Target, failed: set[str], tried: Tried, measures: Sequence[Measure]) -> Change:
    """Say whether a remedy mends what it is for: chatter, or everything else that failed."""
    firm = _FIRM.keys() <= tried.row.keys()
    aimed = failed - _CHATTER if firm else failed & {*_CHATTER, _LOST}
    left = [each for each in missed(measures) if each.name in {*aimed, _LOST}]
    found = {each.name for each in measures}
    cures = not left and aimed - {_LOST} <= found
    said = " and ".join(f"{name} {written(value)}" for name, value in tried.row.items())
    what = ", ".join(sorted(name.replace("_", " ") for name in aimed))
    numbers = ", ".join(_worst(measures, name) for name in sorted(aimed))
    verb = "cures" if cures else "does not cure"
    return change(target, tried.row, cures=cures, shown=f"{said} {verb} {what}: {numbers}")


def _worst(measures: Sequence[Measure], name: str) -> str:
    values = [each for each in measures if each.name == name]
    if name == _LOST and not values:
        return "none"
    if not values or any(each.value is None for each in values):
        return "not held"
    worst = max(each.value or 0.0 for each in values)
    return f"{worst:.3g} {values[0].unit}"
