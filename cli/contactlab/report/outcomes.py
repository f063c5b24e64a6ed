"""The labels of a store's runs: how often each occurs, its letter and its colour."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from contactlab.measure import LABELS
from contactlab.store import Store
from contactlab.tradeoff import COLOURS, REST

STABLE = "stable"
CALM = "#dbe5de"
"""What is stable stays in the background."""
_ORDER = (2, 1, 3, 0, 4, 5, 6, 7)
"""The palette with its reds first, for the worst labels."""


@dataclass(frozen=True)
class Outcomes:
    """The worst label of n runs.

    Attributes:
        names: labels that occur, the worst first and `stable` last.
        letters: one of each, none alike; empty for `stable`.
        colours: one of each.
        meanings: what each says of a run.
        counts: runs of each.
        codes: (n,) the place of each run's label in `names`.
        masks: (n,) all labels of a run: bit i for `every[i]`.
        every: labels that occur at all, also beside a worse one.
    """

    names: tuple[str, ...]
    letters: tuple[str, ...]
    colours: tuple[str, ...]
    meanings: tuple[str, ...]
    counts: tuple[int, ...]
    codes: NDArray[np.int64]
    masks: NDArray[np.int64]
    every: tuple[str, ...]

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(n,) whether a run has a failure label."""
        stable = [name == STABLE for name in self.names]
        return ~np.array([*stable, False])[self.codes]

    @property
    def legend(self) -> tuple[str, ...]:
        """Labels with their letters."""
        return tuple(map(lettered, self.letters, self.names))


def lettered(letter: str, name: str) -> str:
    """Return a label with its letter in front."""
    return f"{letter}  {name}" if letter else name


def read_outcomes(store: Store, also: Sequence[str] = ()) -> Outcomes:
    """Return the labels of a store's runs.

    Args:
        store: the store.
        also: labels that are to be named beside those that occur.
    """
    codes, words = store.columns.words("label")
    told = [str(name) for name in store.columns.shared.get("severity", ())]
    ranks = {name: rank for rank, name in enumerate([*LABELS, *told])}
    named = dict.fromkeys((*words, *also))
    names = sorted(named, key=lambda name: (name == STABLE, ranks.get(name, -1), name))
    places = np.array([names.index(word) for word in words], dtype=np.int64)
    placed = places[codes]
    failures = [name for name in names if name != STABLE]
    letters = dict(zip(failures, _letters(failures), strict=True))
    colours = {name: _colour(rank) for rank, name in enumerate(failures)}
    masks, every = store.columns.word_sets("labels")
    return Outcomes(
        names=tuple(names),
        letters=tuple(letters.get(name, "") for name in names),
        colours=tuple(colours.get(name, CALM) for name in names),
        meanings=tuple(LABELS[name].meaning if name in LABELS else "" for name in names),
        counts=tuple(np.bincount(placed, minlength=len(names)).tolist()),
        codes=placed,
        masks=masks,
        every=every,
    )


def _letters(names: list[str]) -> list[str]:
    """Return a letter of each name that no name before it has; a digit where none is left."""
    taken: list[str] = []
    for name in names:
        wanted = [*name.upper().replace("_", ""), *"ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"]
        taken.append(next(letter for letter in wanted if letter not in taken))
    return taken


def _colour(rank: int) -> str:
    return COLOURS[_ORDER[rank]] if rank < len(_ORDER) else REST
