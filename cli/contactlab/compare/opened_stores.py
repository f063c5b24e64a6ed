"""The two stores, opened and checked."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contactlab.compare.verdicts import CHANGED, SAME, CheckSubject, make_check, skipped_check
from contactlab.errors import PolicyError, StoreError
from contactlab.schema import (
    Check,
    ComparedStore,
    ComparePolicy,
    Difference,
    Sameness,
    StoreManifest,
)
from contactlab.store import Address, RunColumns, Store, verify

_MOST_PROBLEMS = 3


@dataclass(frozen=True)
class OpenedStore:
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


def open_both(
    baseline: Address, candidate: Address, *, thorough: bool
) -> tuple[OpenedStore, OpenedStore]:
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


def _opened(role: str, path: Address, *, thorough: bool) -> OpenedStore:
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
    side = OpenedStore(role, Store.open(path))
    if side.manifest.runs == 0:
        raise StoreError(f"the {role} {path} is empty: it holds no runs")
    return side


_TABLES: Mapping[str, Callable[[OpenedStore], Mapping[str, object]]] = {
    "metric_versions": lambda side: side.manifest.sweep.metric_versions,
    "thresholds": lambda side: side.manifest.sweep.resolved.get("thresholds", {}),
}
_WORDS: Mapping[str, Callable[[OpenedStore], str]] = {
    "sweep": lambda side: side.manifest.sweep.name,
    "scene": lambda side: side.manifest.sweep.scene,
    "scene_hash": lambda side: side.manifest.sweep.scene_hash,
    "engine": lambda side: side.described().engine,
    "contactlab": lambda side: side.manifest.provenance.contactlab,
    "python": lambda side: side.manifest.provenance.python,
    "numpy": lambda side: side.manifest.provenance.numpy,
    "cpu_model": lambda side: side.manifest.provenance.host.cpu_model,
    "cpu_flags": lambda side: side.manifest.provenance.host.cpu_flags,
    "os": lambda side: side.manifest.provenance.host.os,
}
# Judged metric by metric and label by label, so that the rest stays comparable.
PARTIAL: frozenset[Sameness] = frozenset({"metric_versions", "thresholds"})


def difference(
    baseline: OpenedStore, candidate: OpenedStore, what: Sameness
) -> tuple[str, str] | None:
    """Return how two stores differ in something, in words; None if they do not."""
    if what in _WORDS:
        words = _WORDS[what](baseline), _WORDS[what](candidate)
        return words if words[0] != words[1] else None
    before, after = _TABLES[what](baseline), _TABLES[what](candidate)
    shared = what == "metric_versions"
    names = before.keys() & after.keys() if shared else before.keys() | after.keys()
    differing = sorted(name for name in names if before.get(name) != after.get(name))
    if not differing:
        return None
    return _listed(before, differing), _listed(after, differing)


def is_required(what: Sameness, policy: ComparePolicy) -> bool:
    """Tell whether stores that differ in something cannot be compared.

    A changed scene is what runs are matched by axes for.
    """
    return what in policy.require.same and not (what == "scene_hash" and policy.match == "axes")


def checked_properties(policy: ComparePolicy) -> tuple[Sameness, ...]:
    """Return all that the policy wants to know of."""
    return tuple(dict.fromkeys((*policy.require.same, *policy.require.warn_if_different)))


def differences(
    baseline: OpenedStore, candidate: OpenedStore, policy: ComparePolicy
) -> Iterator[Difference]:
    """Yield all that differs, of what the policy wants to know of."""
    for what in checked_properties(policy):
        if told := difference(baseline, candidate, what):
            required = is_required(what, policy)
            yield Difference(what=what, baseline=told[0], candidate=told[1], required=required)


def sameness_checks(
    baseline: OpenedStore, candidate: OpenedStore, policy: ComparePolicy
) -> Iterator[Check]:
    """Yield one check for all that the policy wants to know of."""
    found = {each.what: each for each in differences(baseline, candidate, policy)}
    for what in checked_properties(policy):
        required = is_required(what, policy)
        level = "gate" if required and what not in PARTIAL else "warn"
        subject = CheckSubject(f"same {what}", "evidence", level, two_sided=True)
        if what not in found:
            yield make_check(subject, np.full(1, SAME, dtype=np.int8), "the same", runs=0)
            continue
        told = f"{found[what].baseline}, now {found[what].candidate}"
        if level == "gate":
            yield skipped_check(subject, f"must be the same, but is {told}")
        else:
            yield make_check(subject, np.full(1, CHANGED, dtype=np.int8), told, runs=0)


def _listed(table: Mapping[str, object], names: list[str]) -> str:
    return ", ".join(f"{name} {table.get(name, 'by default')}" for name in names)
