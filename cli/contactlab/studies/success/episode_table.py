"""Episodes by case and variant: their successes, the physical ones, and the causes of losses."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from contactlab.scene.variants import AS_WRITTEN
from contactlab.studies.success.decisive_contacts import ContactVerdict

Case = tuple[object, ...]
"""Values of the sweep's own axes, and the seed."""


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        success: whether the environment calls it a success; None if it says nothing.
        problem: why it was not played as asked; empty if it was.
        contact: the contacts of its object, of an episode as written.
    """

    run_id: str
    success: bool | None
    problem: str = ""
    contact: ContactVerdict | None = None


@dataclass
class EpisodeTable:
    """Episodes by case, then by variant.

    Attributes:
        numerics: names of the variants that an outcome must not depend on.
    """

    numerics: Sequence[str]
    rows: dict[Case, dict[str, Episode]] = field(default_factory=dict[Case, dict[str, Episode]])

    def add_episode(self, case: Case, variant: str, episode: Episode) -> None:
        """Add an episode."""
        self.rows.setdefault(case, {})[variant] = episode

    @property
    def cases(self) -> list[Case]:
        """The cases with an outcome as written."""
        return [case for case in self.rows if self.find_outcome(case, AS_WRITTEN) is not None]

    def find_outcome(self, case: Case, variant: str) -> bool | None:
        """Return whether an episode succeeds; None if it is unknown."""
        episode = self.rows[case].get(variant)
        return None if episode is None or episode.problem else episode.success

    def is_physical(self, case: Case) -> bool:
        """Return whether a case succeeds by sound contacts and under all variants of numerics."""
        return self.find_outcome(case, AS_WRITTEN) is True and not self.find_losses(case)

    def has_sound_contacts(self, case: Case) -> bool:
        """Return whether a case succeeds as written, and nothing speaks against its contacts."""
        contact = self.rows[case][AS_WRITTEN].contact
        return self.find_outcome(case, AS_WRITTEN) is True and (contact is None or contact.is_sound)

    def find_losses(self, case: Case) -> tuple[str, ...]:
        """Return the causes that take the success of a case away: labels, a depth, variants."""
        contact = self.rows[case][AS_WRITTEN].contact
        by_contact = tuple(contact.causes) if contact else ()
        lost = (name for name in self.numerics if self.find_outcome(case, name) is False)
        return (*by_contact, *lost)

    def find_first_losses(self) -> Mapping[str, Case]:
        """Return the first success that each variant of numerics takes away, by variant."""
        first_cases = dict[str, Case]()
        for case in self._lost_cases():
            for cause in self.find_losses(case):
                if cause in self.numerics:
                    first_cases.setdefault(cause, case)
        return first_cases

    def count_outcomes(self, variant: str) -> "PairedOutcomes":
        """Return the outcomes of a variant next to those as written."""
        pairs = [
            (before, after)
            for case in self.cases
            if (before := self.find_outcome(case, AS_WRITTEN)) is not None
            and (after := self.find_outcome(case, variant)) is not None
        ]
        return PairedOutcomes(
            pairs=len(pairs),
            good=sum(after for _, after in pairs),
            gained=sum(after and not before for before, after in pairs),
            lost=sum(before and not after for before, after in pairs),
        )

    def count_physical(self) -> int:
        """Return the number of physical successes."""
        return sum(map(self.is_physical, self.cases))

    def count_successes(self) -> int:
        """Return the number of successes as written."""
        return sum(bool(self.find_outcome(case, AS_WRITTEN)) for case in self.cases)

    def count_losses(self) -> Mapping[str, tuple[int, int]]:
        """Return the successes that each cause takes away, and those that it takes away alone."""
        every, alone = Counter[str](), Counter[str]()
        for case in self._lost_cases():
            causes = self.find_losses(case)
            every.update(causes)
            if len(causes) == 1:
                alone.update(causes)
        return {name: (count, alone[name]) for name, count in every.most_common()}

    def _lost_cases(self) -> Iterator[Case]:
        for case in self.cases:
            if self.find_outcome(case, AS_WRITTEN) and self.find_losses(case):
                yield case


@dataclass(frozen=True)
class PairedOutcomes:
    """Outcomes of a variant in cases with a known outcome as written."""

    pairs: int
    good: int
    gained: int
    lost: int

    @property
    def changed_outcomes(self) -> int:
        """The number of outcomes that differ."""
        return self.gained + self.lost
