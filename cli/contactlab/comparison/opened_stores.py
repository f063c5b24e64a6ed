"""The two stores: opened, checked, and how they differ as a whole."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from contactlab.comparison.checks import CHANGED, SAME, CheckSubject
from contactlab.errors import PolicyError, StoreError
from contactlab.schema.compare_policy import ComparePolicy, Sameness
from contactlab.schema.comparison_report import Check, ComparedStore, Difference
from contactlab.store.finished_store import Store
from contactlab.store.store_address import Address
from contactlab.store.verify_store import verify

_MOST_PROBLEMS = 3


def described(store: Store) -> ComparedStore:
    """Return how a report describes a store."""
    manifest, origin = store.manifest, store.manifest.provenance
    engine = manifest.sweep.engine
    return ComparedStore(
        store=str(store.address),
        sweep=manifest.sweep.name,
        runs=manifest.runs,
        engine=f"{engine.name} {engine.version}",
        contactlab=origin.contactlab,
        git_revision=origin.git_revision,
        cpu_model=origin.host.cpu_model,
        finished=manifest.finished,
    )


def open_both(
    baseline: Address, candidate: Address, policy: ComparePolicy, *, thorough: bool = False
) -> tuple[Store, Store]:
    """Open two stores and verify them; thoroughly means every record and the bytes of every trace.

    Raises:
        PolicyError: both are the same store.
        StoreError: one of them is missing, damaged, empty, unfinished or of another version; or
            the baseline is not the one that the policy pins.
    """
    paths = [each for each in (baseline, candidate) if isinstance(each, Path) and each.exists()]
    if baseline == candidate or (len(paths) == 2 and paths[0].samefile(paths[1])):
        raise PolicyError(
            f"{baseline} and {candidate} are the same store; compare the stores of two sweeps"
        )
    before = _open("baseline", baseline, thorough=thorough)
    if policy.baseline_digest not in {None, before.digest}:
        raise StoreError(
            f"the baseline {baseline} has the digest {before.digest}, not "
            f"{policy.baseline_digest}, which is pinned; pin the new one if it was meant to change"
        )
    return before, _open("candidate", candidate, thorough=thorough)


def _open(role: str, address: Address, *, thorough: bool) -> Store:
    try:
        problems = verify(address, thorough=thorough)
    except StoreError as error:
        raise StoreError(f"the {role} cannot be read: {error}") from error
    if problems:
        first = "; ".join(problems[:_MOST_PROBLEMS])
        more = len(problems) - _MOST_PROBLEMS
        rest = f"; and {more} more problems" if more > 0 else ""
        raise StoreError(
            f"the {role} {address} is not sound: {first}{rest} (see `contactlab verify {address}`)"
        )
    opened = Store.unchecked(address)
    if opened.manifest.runs == 0:
        raise StoreError(f"the {role} {address} is empty: it holds no runs")
    return opened


_PROPERTIES: Mapping[Sameness, Callable[[Store], str | Mapping[str, object]]] = {
    "sweep": lambda each: each.manifest.sweep.name,
    "scene": lambda each: each.manifest.sweep.scene,
    "scene_hash": lambda each: each.manifest.sweep.scene_hash,
    "metric_versions": lambda each: each.manifest.sweep.metric_versions,
    "thresholds": lambda each: each.manifest.sweep.resolved.get("thresholds", {}),
    "engine": lambda each: described(each).engine,
    "contactlab": lambda each: each.manifest.provenance.contactlab,
    "python": lambda each: each.manifest.provenance.python,
    "numpy": lambda each: each.manifest.provenance.numpy,
    "cpu_model": lambda each: each.manifest.provenance.host.cpu_model,
    "cpu_flags": lambda each: each.manifest.provenance.host.cpu_flags,
    "os": lambda each: each.manifest.provenance.host.os,
}
# Metrics and labels are checked one by one: those that have not changed stay comparable.
_JUDGED_ONE_BY_ONE = {"metric_versions", "thresholds"}


def difference(baseline: Store, candidate: Store, what: Sameness) -> tuple[str, str] | None:
    """Return the two values of a property in which two stores differ; None if they do not."""
    before, after = (_PROPERTIES[what](each) for each in (baseline, candidate))
    if isinstance(before, str) or isinstance(after, str):
        return (str(before), str(after)) if before != after else None
    shared = what == "metric_versions"
    names = before.keys() & after.keys() if shared else before.keys() | after.keys()
    differing = sorted(name for name in names if before.get(name) != after.get(name))
    if not differing:
        return None
    return _format_table(before, differing), _format_table(after, differing)


def _format_table(table: Mapping[str, object], names: list[str]) -> str:
    return ", ".join(f"{name} {table.get(name, 'by default')}" for name in names)


def sameness_checks(
    baseline: Store, candidate: Store, policy: ComparePolicy
) -> Iterator[tuple[Check, Difference | None]]:
    """Yield one check for each property that the policy names, and in what the stores differ."""
    for what in dict.fromkeys((*policy.require.same, *policy.require.warn_if_different)):
        # A changed scene is what runs are matched by axes for.
        changes_scene = what == "scene_hash" and policy.match == "axes"
        required = what in policy.require.same and not changes_scene
        is_gate = required and what not in _JUDGED_ONE_BY_ONE
        level = "gate" if is_gate else "warn"
        subject = CheckSubject(f"same {what}", "evidence", level, two_sided=True)
        values = difference(baseline, candidate, what)
        if values is None:
            yield subject.single(SAME, "the same"), None
            continue
        old, new = values
        found = Difference(what=what, baseline=old, candidate=new, required=required)
        if is_gate:
            yield subject.skipped(f"must be the same, but is {old}, now {new}"), found
        else:
            yield subject.single(CHANGED, f"{old}, now {new}"), found


def store_checks(baseline: Store, candidate: Store) -> Iterator[Check]:
    """Yield whether the stores are of two sweeps, in the right order; these checks only warn."""
    old, new = baseline.manifest, candidate.manifest
    copied = (old.started, old.finished, old.sweep) == (new.started, new.finished, new.sweep)
    warning = "both were written at the same instant: the sweep did not run again"
    yield _warning(
        "candidate is no copy", warning if copied else "", "written by a sweep of its own"
    )
    swapped = new.finished < old.finished
    warning = f"finished {new.finished[:19]}, before the baseline: are they swapped?"
    yield _warning("candidate is newer", warning if swapped else "", "finished after the baseline")


def _warning(name: str, warning: str, fine: str) -> Check:
    subject = CheckSubject(name, "evidence", "warn", two_sided=True)
    return subject.single(CHANGED if warning else SAME, warning or fine)
