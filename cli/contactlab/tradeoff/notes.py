"""What a reader of a trade-off should know before trusting it."""

from collections.abc import Iterable, Iterator, Sequence

from contactlab.schema import Setting
from contactlab.tradeoff.configurations import Weighed, Weighing
from contactlab.tradeoff.runs import Runs, is_chaotic

_NOISY = 0.05


def notes(
    found: Sequence[Weighed],
    runs: Runs,
    weighing: Weighing,
    chosen: Weighed | None,
    idle: Sequence[str],
) -> Iterator[str]:
    """Yield what looks wrong, or limits what the numbers say."""
    yield from _of_time(weighing)
    yield from _of_error(found, weighing)
    yield from _of_model(found, runs, weighing, chosen)
    if not weighing.tolerances:
        yield "no tolerance is given: the recommendation only has no failure label; see --tolerance"
    most = max(len(each.group.cases) for each in found)
    short = sum(len(each.group.cases) < most for each in found)
    if short:
        yield f"{short} configurations were not run in every scenario and seed: none is feasible"
    if idle:
        yield f"no error changes by more than 1 % with {', '.join(idle)}"
    if chosen is not None:
        yield from _at_edge(chosen, runs)


def _of_time(weighing: Weighing) -> Iterator[str]:
    time = weighing.time
    if time.source == "recording":
        yield (
            "times are of the recorded runs, on a busy machine: good to 10 % at best; "
            "sweep with `timing: {rounds: 3}`"
        )
    elif time.spread is not None and time.spread > _NOISY:
        yield (
            f"rounds of the timing pass differ by {time.spread:.0%}, median over minimum: "
            "configurations nearer than that are not told apart"
        )


def _of_error(found: Sequence[Weighed], weighing: Weighing) -> Iterator[str]:
    below = sum(each.summary.below_estimate for each in found)
    if below:
        yield (
            f"{below} of {len(found)} configurations have an error below what the reference "
            "itself may be off by, which stands for it"
        )
    unknown = sum(each.summary.error is None for each in found)
    if unknown:
        yield f"{unknown} of {len(found)} configurations have runs without {weighing.error.name}"


def _of_model(
    found: Sequence[Weighed], runs: Runs, weighing: Weighing, chosen: Weighed | None
) -> Iterator[str]:
    if "tied" in runs.solref_rules:
        yield "solref follows the timestep: each timestep simulates another contact"
    if is_chaotic(runs) and weighing.error.against == "trajectory":
        yield (
            "the motion is chaotic: distances of trajectories say little; sweep with "
            "`accuracy: {error: invariants}`"
        )
    clamped = sum(each.summary.solref_clamped for each in found)
    if clamped:
        yield (
            f"{clamped} of {len(found)} configurations ask for a contact faster than two "
            "timesteps; the engine's refsafe softens it, so that these simulate another contact"
        )
    if chosen is not None and chosen.summary.solref_clamped:
        yield "the recommended configuration is one of these"


def _at_edge(chosen: Weighed, runs: Runs) -> Iterator[str]:
    for name, value in chosen.group.values.items():
        numbers = _numbers(runs.knobs[name])
        if len(numbers) > 2 and value in (numbers[0], numbers[-1]):
            end = "smallest" if value == numbers[0] else "largest"
            yield f"{name} {value:g} is the {end} that was tried"


def _numbers(values: Iterable[Setting]) -> list[float]:
    """Return the different numbers among some values, in order."""
    found = {each for each in values if isinstance(each, int | float)}
    return sorted(each for each in found if not isinstance(each, bool))
