"""Stores that are broken, swapped, copied or of other runs: each is told, none compares equal."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from contactlab.comparison.compare_stores import compare_stores
from contactlab.comparison.report import report_of
from contactlab.errors import ContactlabError, PolicyError, StoreError
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.finding import Finding
from contactlab.store.atomic_files import sha256_of
from contactlab.writers import as_text

Runs = Callable[[], Any]
Stored = Callable[..., Path]


def policy(**changes: Any) -> ComparePolicy:
    return ComparePolicy.model_validate({"version": 1, **changes})


def check(report: ComparisonReport, name: str, group: str = "") -> Finding:
    (found,) = [each for each in report.findings if (each.name, each.group) == (name, group)]
    return found


def test_the_same_runs_are_bitwise_equal(baseline: Path, runs: Runs, stored: Stored) -> None:
    report = compare_stores(baseline, stored("again", runs()))
    assert (report.verdict, report.exit_code) == ("same", 0)
    assert report.pairs.bitwise_equal == report.pairs.paired == 8
    assert {each.outcome for each in report.findings} == {"passed"}
    assert "8 paired by id, all bitwise equal" in as_text(report_of(report))


def test_swapped_sides(baseline: Path, runs: Runs, stored: Stored) -> None:
    worse = runs()
    worse.measure(3, depth=1.5e-3)
    candidate = stored("worse", worse)
    assert compare_stores(baseline, candidate).verdict == "worse"
    report = compare_stores(candidate, baseline)
    assert (report.verdict, report.exit_code) == ("better", 0)
    swapped = check(report, "candidate is newer")
    assert swapped.outcome == "warned"
    assert swapped.message.endswith("before the baseline: are they swapped?")


def test_a_missing_run_and_one_more(baseline: Path, runs: Runs, stored: Stored) -> None:
    fewer, more = runs(), runs()
    del fewer.runs[2]
    last: EvidenceRecord = more.runs[-1]
    more.runs.append(last.model_copy(update={"run_id": "f" * 16, "index": 8, "seed": 1}))
    report = compare_stores(baseline, stored("fewer", fewer))
    assert (report.verdict, report.exit_code, report.pairs.missing) == ("missing", 1, 1)
    assert report.headline.startswith("runs missing: 1 of ")
    missing = check(report, "no missing runs")
    assert missing.message == "1 of 8 runs not in the candidate"
    assert missing.worst[0].baseline_run == f"{3:016x}"
    report = compare_stores(baseline, stored("more", more))
    assert (report.verdict, report.exit_code, report.pairs.new) == ("changed", 0, 1)
    assert check(report, "no new runs").message == "1 run not in the baseline"
    strict = compare_stores(baseline, stored("more2", more), policy(new_runs="gate"))
    assert strict.exit_code == 1


def test_another_engine_warns_or_is_refused(baseline: Path, runs: Runs, stored: Stored) -> None:
    other = runs()
    engine = other.runs[0].engine.model_copy(update={"version": "3.17.0"})
    other.identity["engine"] = engine
    other.measure(0, depth=1.0)
    candidate = stored("other", other)
    report = compare_stores(baseline, candidate)
    assert check(report, "same engine").message == "mujoco 4.0.0, now mujoco 3.17.0"
    assert report.exit_code == 1
    strict = compare_stores(baseline, candidate, policy(require={"same": ["engine"]}))
    assert (strict.verdict, strict.exit_code) == ("not comparable", 3)


def test_a_copy_of_the_baseline_is_told(baseline: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    baseline.rename(copy)
    (tmp_path / "baseline").mkdir()
    for path in sorted(copy.rglob("*")):
        other = tmp_path / "baseline" / path.relative_to(copy)
        other.mkdir() if path.is_dir() else other.write_bytes(path.read_bytes())
    found = check(compare_stores(baseline, copy), "sweep ran again")
    assert (found.outcome, found.message[:12]) == ("warned", "no: both sto")


def test_a_store_with_itself(baseline: Path) -> None:
    with pytest.raises(PolicyError, match="are the same store; compare the stores") as raised:
        compare_stores(baseline, baseline)
    assert raised.value.exit_code == 2


BROKEN: dict[str, tuple[Callable[[Any, Path], object], str]] = {
    "truncated table": (
        lambda by, store: by.cut(store / "runs.parquet"),
        r"is not sound: runs\.parquet: changed since it was written; runs\.parquet: .* is damaged",
    ),
    "missing table": (
        lambda _, store: (store / "runs.parquet").unlink(),
        r"is not sound: runs\.parquet: missing",
    ),
    "missing trace": (
        lambda by, store: by.edit(store, "trace_file", 0, "traces/01/x.mcap"),
        r"is not sound: traces/01/x\.mcap: missing",
    ),
    "another schema version": (
        lambda by, store: by.substitute(
            store / "manifest.json", '"store_version": 4', '"store_version": 5'
        ),
        "cannot be read: .*is of store version 5; this contactlab reads version 4",
    ),
    "another record version": (
        lambda by, store: by.reshare(store, "schema_version", 9),
        "its records are of version 9; this contactlab reads version 2",
    ),
    "no manifest": (
        lambda _, store: (store / "manifest.json").unlink(),
        "cannot be read: .* is unfinished",
    ),
    "a run twice": (
        lambda by, store: by.edit(store, "run_id", 1, f"{1:016x}"),
        f"is not sound: runs.parquet: run {1:016x} occurs 2 times",
    ),
}


@pytest.mark.parametrize("defect", BROKEN)
@pytest.mark.parametrize("side", ["baseline", "candidate"])
def test_a_broken_store(
    baseline: Path, runs: Runs, stored: Stored, tampering: Any, defect: str, side: str
) -> None:
    stores = {"baseline": baseline, "candidate": stored("candidate", runs())}
    damage, message = BROKEN[defect]
    damage(tampering, stores[side])
    with pytest.raises(StoreError, match=f"the {side} .*{message}") as raised:
        compare_stores(stores["baseline"], stores["candidate"])
    assert raised.value.exit_code == 3


@pytest.mark.parametrize("side", ["baseline", "candidate"])
def test_an_empty_store(runs: Runs, stored: Stored, tampering: Any, side: str) -> None:
    stores = {"baseline": stored("baseline", runs()), "candidate": stored("candidate", runs())}
    path = stores[side]
    tampering.rewrite(path, pq.read_table(path / "runs.parquet").slice(0, 0))
    counts = {"runs": 0, "labels": {}, "statuses": {}, "traces": 0, "expectations": {}}
    manifest = json.loads((path / "manifest.json").read_text())
    manifest["sweep"]["runs_asked"] = 0
    (path / "manifest.json").write_text(json.dumps(manifest | counts))
    identity = json.loads((path / "sweep.json").read_text()) | {"runs_asked": 0}
    (path / "sweep.json").write_text(json.dumps(identity))
    tampering.rehash(path)
    with pytest.raises(StoreError, match=f"the {side} .*runs is 0, but a store has some"):
        compare_stores(stores["baseline"], stores["candidate"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"metrics": {"dept": {"rel": 1.0}}}, "no such metric; did you mean 'depth'?"),
        (
            {"metrics": {"depth": {"by": ["con"]}}},
            "is not an axis of the baseline; did you mean 'cone'",
        ),
        ({"waive": [{"check": "depth", "max": 1, "reason": "x"}]}, "which is not a check"),
        (
            {"labels": {"allow": [{"from": "stabel", "to": "chatter", "max": 1, "reason": "x"}]}},
            "no such label; did you mean 'stable'?",
        ),
    ],
)
def test_a_policy_that_does_not_fit(
    baseline: Path, runs: Runs, stored: Stored, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ContactlabError) as raised:
        compare_stores(baseline, stored("again", runs()), policy(**changes))
    assert message in str(raised.value)
    assert raised.value.exit_code == 2


def test_another_baseline_than_the_pinned_one(baseline: Path, runs: Runs, stored: Stored) -> None:
    candidate, digest = stored("again", runs()), sha256_of(baseline / "manifest.json")
    pinned = ComparePolicy(version=1, baseline_digest=digest)
    assert compare_stores(baseline, candidate, pinned).exit_code == 0
    with pytest.raises(StoreError, match=f"has the digest {digest}, not 0+, which is pinned"):
        compare_stores(baseline, candidate, ComparePolicy(version=1, baseline_digest="0" * 64))
