"""Compares a store with a lock, group by group.

Runs of the locked starts repeat each other, and the mean of a group may change by the tolerance of
`compare` for the metric: `abs + rel * |mean|`, its resolution. Other starts, of other seeds, give
other values: two means of n and m independent values with the pooled spread s differ by chance by
more than t s sqrt(1/n + 1/m) in a share alpha of all pairs (Student's t-test, where t is the
1 - alpha / 2 quantile at n + m - 2 degrees of freedom). This change is allowed besides the
resolution. Numbers of runs with an outcome are judged by Fisher's exact test at the same alpha. It
is 0.1 % over all judgements (Bonferroni): one of a thousand checks fails by chance without a
change.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import stats

from contactlab.comparison.compare_stores import describe_store, draw_conclusion
from contactlab.judge.policies import EffectiveRule, effective_rule
from contactlab.judge.subjects import CHANGED, MISSING, SAME, Subject
from contactlab.judge.wording import plural
from contactlab.schema.comparison import ComparePolicy, ComparisonReport, PairCounts
from contactlab.schema.finding import Finding, RunPair
from contactlab.store.finished_store import Store
from contactlab.store.table_layout import Column
from contactlab.studies.lock.lock_file import (
    gated_metrics,
    group_members,
    is_recorded,
    lock_of,
    metric_columns,
)
from contactlab.studies.lock.lock_model import Group, Lock

_CAUSES = {"engine": "the engine", "scene_hash": "the scene"}


class _GroupChange(NamedTuple):
    """Change of a group, and its excess over the allowed change, in tolerances."""

    group: Group
    code: int
    before: float | str | None = None
    after: float | str | None = None
    excess: float = 0.0


@dataclass(frozen=True)
class _Judge:
    """Judges the groups of a store by those of a lock."""

    lock: Lock
    new: Lock
    repeated: bool
    policy: ComparePolicy
    runs: dict[str, str]  # a run of each group of the store
    gated: Sequence[str]  # metrics of the store that the policy gates

    @property
    def pairs(self) -> list[tuple[Group, Group]]:
        """The groups that both have."""
        here = self.new.by_key
        return [(group, here[group.key]) for group in self.lock.groups if group.key in here]

    @property
    def alpha(self) -> float:
        """How likely one judgement may be wrong."""
        test_counts = (
            len(old.metrics) + len({*old.outcomes, *new.outcomes}) for old, new in self.pairs
        )
        by_chance = 1e-3
        return by_chance / max(1, sum(test_counts))

    def checks(self, columns: dict[str, Column]) -> Iterator[Finding]:
        """Yield all checks."""
        for name in _CAUSES:
            before, after = self._both_values(name)
            same = Subject(f"same {name}", "evidence", "warn", two_sided=True)
            change_text = "the same" if before == after else f"{before}, now {after}"
            yield same.make_single(SAME if before == after else CHANGED, change_text)
        old, new, rules = self.lock.by_key, self.new.by_key, self.policy
        subject = Subject("no missing groups", "runs", rules.missing_runs)
        yield self._make_check(
            subject, [_GroupChange(old[key], MISSING) for key in old if key not in new]
        )
        subject = Subject("no new groups", "runs", rules.new_runs, two_sided=True)
        yield self._make_check(
            subject, [_GroupChange(new[key], CHANGED) for key in new if key not in old]
        )
        subject = Subject("outcomes as locked", "labels", rules.labels.level, two_sided=True)
        yield self._make_check(subject, [self._judge_outcomes(*pair) for pair in self.pairs])
        grouped = dict.fromkeys(name for group in self.lock.groups for name in group.metrics)
        for metric in grouped:
            yield self._judge_metric(metric, columns.get(metric))
        for metric in (name for name in self.lock.metric_versions if name not in grouped):
            struck = Subject(f"{metric} as locked", "metrics", "gate")
            yield struck.make_skipped(
                "the lock names it, but no group has its values: lock it again"
            )
        for metric in (name for name in self.gated if name not in self.lock.metric_versions):
            if metric not in grouped:
                unlocked = Subject(f"{metric} as locked", "metrics", "warn", two_sided=True)
                yield unlocked.make_single(
                    CHANGED, "the policy gates it, but it is not in the lock"
                )

    def _both_values(self, name: str) -> tuple[object, object]:
        return getattr(self.lock, name), getattr(self.new, name)

    @property
    def cause(self) -> str:
        """Changes that may have changed outcomes, as the beginning of a sentence; or ""."""
        changed = [word for name, word in _CAUSES.items() if len({*self._both_values(name)}) > 1]
        return f"{' and '.join(changed)} changed since the lock; " if changed else ""

    def _judge_outcomes(self, old: Group, new: Group) -> _GroupChange:
        counts = {
            name: [(side.outcomes.get(name, 0), side.runs) for side in (old, new)]
            for name in {**old.outcomes, **new.outcomes}
        }
        wrong = {name: count for name, count in counts.items() if self._name_differences(*count)}
        before, after = (
            ", ".join(
                f"{name} {tally[side][0]} of {tally[side][1]}" for name, tally in wrong.items()
            )
            for side in (0, 1)
        )
        return _GroupChange(old, CHANGED if wrong else SAME, before, after)

    def _name_differences(self, old: tuple[int, int], new: tuple[int, int]) -> bool:
        """Return whether two counts, each with how many runs there are, differ."""
        if self.repeated:
            return old != new
        table = [[count, total - count] for count, total in (old, new)]
        return float(np.asarray(stats.fisher_exact(table))[1]) < self.alpha

    def _judge_metric(self, metric: str, column: Column | None) -> Finding:
        if column is None:
            metric_subject = Subject(f"{metric} as locked", "metrics", "gate")
            return metric_subject.make_skipped("is not a metric any more")
        rule = effective_rule(column, self.policy)
        subject = Subject(
            f"{metric} as locked", "metrics", rule.level, "", column.unit, rule.budget, True
        )
        versions = [record.metric_versions.get(metric) for record in (self.lock, self.new)]
        if len({*versions}) > 1:
            return subject.make_skipped("its definition changed: lock it again")
        pairs = [pair for pair in self.pairs if any(metric in group.metrics for group in pair)]
        if not self.repeated and pairs and all(old.runs + new.runs < 3 for old, new in pairs):
            return subject.make_skipped(
                "single runs of other starts tell nothing: lock several seeds"
            )
        return self._make_check(
            subject, [self._measure_group(metric, rule, *pair) for pair in pairs]
        )

    def _measure_group(
        self, metric: str, rule: EffectiveRule, old: Group, new: Group
    ) -> _GroupChange:
        (before, spread, n), (after, other, m) = (
            side.summarize_metric(metric) for side in (old, new)
        )
        if not n or not m or (self.repeated and n != m):
            return _GroupChange(old, MISSING, f"{n} values", f"{m} values")
        allowed = rule.limit.allow_change(before)
        if not self.repeated:
            allowed += change_by_chance((spread, n), (other, m), self.alpha)
        excess = abs(after - before) / allowed if allowed else float(after != before) * math.inf
        return _GroupChange(old, CHANGED if excess > 1 else SAME, before, after, excess)

    def _make_check(self, subject: Subject, group_changes: Sequence[_GroupChange]) -> Finding:
        wrong = sorted(
            (change for change in group_changes if change.code), key=lambda change: -change.excess
        )
        summary = (
            f"{len(wrong):,} of {plural(len(group_changes), 'group')}" if wrong else "as locked"
        )
        worst = [
            RunPair(
                baseline_run=None,
                candidate_run=self.runs.get(change.group.key),
                axes=change.group.at,
                baseline=change.before,
                candidate=change.after,
            )
            for change in wrong
        ]
        return subject.make_finding(
            np.array([change.code for change in group_changes], np.int8), summary, worst
        )


def change_by_chance(old: tuple[float, int], new: tuple[float, int], alpha: float) -> float:
    """Return by how much two means differ in a share alpha of all pairs; infinity if unknown.

    Each has the spread of its values, and their number.
    """
    (spread, n), (other, m) = old, new
    if (free := n + m - 2) < 1:
        return math.inf
    pooled = math.sqrt(((n - 1) * spread**2 + (m - 1) * other**2) / free)
    return float(stats.t.isf(alpha / 2, free)) * pooled * math.sqrt(1 / n + 1 / m)


def judge_lock(lock: Lock, name: str, store: Store, policy: ComparePolicy) -> ComparisonReport:
    """Return the comparison of a lock, by its name for people, and a store."""
    columns = metric_columns(store)
    metrics = dict.fromkeys(metric for group in lock.groups for metric in group.metrics)
    new = lock_of(store, [metric for metric in metrics if metric in columns])
    same_seeds = lock.seeds == new.seeds and not is_recorded(store)
    repeated = not lock.chaotic and (lock.starts == new.starts or same_seeds)
    runs = {key: store.columns.run_id(rows[0]) for key, (_, rows) in group_members(store).items()}
    judge = _Judge(lock, new, repeated, policy, runs, gated_metrics(store, policy))
    checks = tuple(judge.checks(columns))
    verdict, exit_code, headline = draw_conclusion(checks)
    by = "repetition" if repeated else "the spread over other starts"
    candidate = describe_store(store)
    locked = {"store": name, "sweep": lock.sweep, "engine": lock.engine, "git_revision": None}
    equal = [pair for pair in judge.pairs if pair[0].trajectories == pair[1].trajectories]
    counts = dict.fromkeys(PairCounts.model_fields, 0)
    counts["paired"] = sum(new.runs for _, new in judge.pairs)
    counts["bitwise_equal"] = sum(new.runs for _, new in equal)
    return ComparisonReport(
        verdict=verdict,
        exit_code=exit_code,
        headline=f"{judge.cause}{headline}; judged by {by}",
        baseline=candidate.model_copy(
            update=locked | {"runs": sum(group.runs for group in lock.groups)}
        ),
        candidate=candidate,
        match="axes",
        pairs=PairCounts(**counts),
        differences=(),
        transitions=(),
        findings=checks,
        advice=(),
    )
