"""What two stores have in common: scene, definitions, engine, machine."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from contactlab.compare.checks import Subject, made, skipped
from contactlab.compare.sides import Side
from contactlab.compare.verdicts import CHANGED, SAME
from contactlab.schema import Check, ComparePolicy, Difference, Sameness

_TABLES: Mapping[str, Callable[[Side], Mapping[str, object]]] = {
    "metric_versions": lambda side: side.manifest.sweep.metric_versions,
    "thresholds": lambda side: side.manifest.sweep.resolved.get("thresholds", {}),
}
_WORDS: Mapping[str, Callable[[Side], str]] = {
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


def difference(baseline: Side, candidate: Side, what: Sameness) -> tuple[str, str] | None:
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


def asked(policy: ComparePolicy) -> tuple[Sameness, ...]:
    """Return all that the policy wants to know of."""
    return tuple(dict.fromkeys((*policy.require.same, *policy.require.warn_if_different)))


def differences(baseline: Side, candidate: Side, policy: ComparePolicy) -> Iterator[Difference]:
    """Yield all that differs, of what the policy wants to know of."""
    for what in asked(policy):
        if told := difference(baseline, candidate, what):
            required = is_required(what, policy)
            yield Difference(what=what, baseline=told[0], candidate=told[1], required=required)


def sameness_checks(baseline: Side, candidate: Side, policy: ComparePolicy) -> Iterator[Check]:
    """Yield one check for all that the policy wants to know of."""
    found = {each.what: each for each in differences(baseline, candidate, policy)}
    for what in asked(policy):
        required = is_required(what, policy)
        level = "gate" if required and what not in PARTIAL else "warn"
        subject = Subject(f"same {what}", "evidence", level, two_sided=True)
        if what not in found:
            yield made(subject, np.full(1, SAME, dtype=np.int8), "the same", runs=0)
            continue
        told = f"{found[what].baseline}, now {found[what].candidate}"
        if level == "gate":
            yield skipped(subject, f"must be the same, but is {told}")
        else:
            yield made(subject, np.full(1, CHANGED, dtype=np.int8), told, runs=0)


def _listed(table: Mapping[str, object], names: list[str]) -> str:
    return ", ".join(f"{name} {table.get(name, 'by default')}" for name in names)
