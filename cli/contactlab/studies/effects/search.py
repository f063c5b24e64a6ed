"""The smallest set of effects within tolerance: greedy, then pairs among what is left."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

from contactlab.schema import Interaction
from contactlab.studies.effects.changes import Difference, difference
from contactlab.studies.effects.tolerances import UNMEASURED
from contactlab.studies.effects.trials import BASE, Changed, Outcome, Trials


@dataclass
class Search:
    """Looks for the smallest set.

    Attributes:
        trials: runs configurations.
        base: the base configuration's outcome.
        tried: how many stores were written.
    """

    trials: Trials
    base: Outcome
    tried: int = field(default=0)

    def smallest(self, certain: Sequence[str], likely: Sequence[str]) -> Changed:
        """Return a largest set of changes that is free, found one by one.

        Args:
            certain: changes that are free by proof.
            likely: changes that are free one by one, the most worthwhile first.
        """
        everything = merged(certain, likely)
        if not everything or self._is_free(everything):
            return everything
        free = merged(certain) if certain and self._is_free(merged(certain)) else BASE
        rest = [each for each in (*certain, *likely) if each not in free]
        # What is refused beside later ones may be free beside earlier ones only, and stays out:
        # each step is checked against the base configuration, not against the step before.
        for name in rest:
            if self._is_free(merged(free, [name])):
                free = merged(free, [name])
        return free

    def interactions(
        self, free: Changed, needed: Sequence[str]
    ) -> tuple[Changed, tuple[Interaction, ...]]:
        """Try all pairs of what is needed one by one; return what is free with them, and all pairs.

        A pair is tried from one seed first; few pass that, and are tried from all.
        """
        pairs = list(combinations(needed, 2))
        if not pairs:
            return free, ()
        seed = self.trials.question.seeds[:1]
        each_changed = {pair: merged(free, pair) for pair in pairs}
        outcomes = self._run([BASE, *each_changed.values()], seeds=seed)
        first = {
            pair: self._difference(changed, outcomes[BASE], outcomes[changed])
            for pair, changed in each_changed.items()
        }
        told: list[Interaction] = []
        for pair, found in first.items():
            passed = not found.matters and self._is_free(merged(free, pair))
            free = merged(free, pair) if passed else free
            told.append(Interaction(effects=pair, free=passed, reason=found.reason))
        return free, tuple(told)

    def _is_free(self, changed: Changed) -> bool:
        outcome = self._run([changed])[changed]
        return not self._difference(changed, self.base, outcome).matters

    def _run(
        self, configurations: Sequence[Changed], seeds: Sequence[int] | None = None
    ) -> Mapping[Changed, Outcome]:
        self.tried += 1
        return self.trials.run(
            f"search-{self.tried:02}", "Effects changed together", configurations, seeds=seeds
        )

    def _difference(self, changed: Changed, base: Outcome, other: Outcome) -> Difference:
        question = self.trials.question
        exempt = exempted(changed, question.tolerances)
        return difference(question, question.scenarios, base, other, exempt)


def merged(*names: Collection[str]) -> Changed:
    """Return the union of changes."""
    return tuple(sorted({name for each in names for name in each}))


def exempted(changed: Collection[str], given: Collection[str]) -> list[str]:
    """Return the metrics that cannot be measured without an effect, and that nobody asked for."""
    lost = (name for effect in changed for name in UNMEASURED.get(effect, ()))
    return [name for name in lost if name not in given]
