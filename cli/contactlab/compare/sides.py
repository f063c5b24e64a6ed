"""The two stores, opened and checked."""

from dataclasses import dataclass
from pathlib import Path

from contactlab.errors import PolicyError, StoreError
from contactlab.schema import ComparedStore, StoreManifest
from contactlab.store import Address, RunColumns, Store, verify

_MOST_PROBLEMS = 3


@dataclass(frozen=True)
class Side:
    """One of the two stores.

    Attributes:
        role: baseline or candidate.
        store: the store.
    """

    role: str
    store: Store

    @property
    def manifest(self) -> StoreManifest:
        """What the store holds."""
        return self.store.manifest

    @property
    def columns(self) -> RunColumns:
        """Its table."""
        return self.store.columns

    def described(self) -> ComparedStore:
        """Return what a report says of it."""
        manifest, origin = self.manifest, self.manifest.provenance
        engine = manifest.sweep.engine
        return ComparedStore(
            store=str(self.store.address),
            sweep=manifest.sweep.name,
            runs=manifest.runs,
            engine=f"{engine.name} {engine.version}",
            contactlab=origin.contactlab,
            git_revision=origin.git_revision,
            cpu_model=origin.host.cpu_model,
            finished=manifest.finished,
        )


def open_sides(baseline: Address, candidate: Address, *, thorough: bool) -> tuple[Side, Side]:
    """Open two stores.

    Args:
        baseline: where what is known is stored.
        candidate: where what is judged is stored.
        thorough: whether to check every record and the bytes of every trace.

    Raises:
        PolicyError: both are the same store.
        StoreError: one of them is missing, damaged, empty, unfinished or of another version.
    """
    if _are_one(baseline, candidate):
        raise PolicyError(
            f"{baseline} and {candidate} are the same store, which says nothing; "
            "compare the stores of two sweeps"
        )
    return (
        _opened("baseline", baseline, thorough=thorough),
        _opened("candidate", candidate, thorough=thorough),
    )


def _are_one(one: Address, other: Address) -> bool:
    if isinstance(one, Path) and isinstance(other, Path):
        return one.exists() and other.exists() and one.samefile(other)
    return one == other


def _opened(role: str, path: Address, *, thorough: bool) -> Side:
    try:
        problems = verify(path, thorough=thorough)
    except StoreError as error:
        raise StoreError(f"the {role} cannot be read: {error}") from error
    if problems:
        shown = "; ".join(problems[:_MOST_PROBLEMS])
        more = len(problems) - _MOST_PROBLEMS
        rest = f"; and {more} more problems" if more > 0 else ""
        raise StoreError(
            f"the {role} {path} is not sound: {shown}{rest} (see `contactlab verify {path}`)"
        )
    side = Side(role, Store.open(path))
    if side.manifest.runs == 0:
        raise StoreError(f"the {role} {path} is empty: it holds no runs")
    return side
