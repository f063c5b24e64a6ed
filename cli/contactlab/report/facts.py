"""What was run, in a few lines: for the head of a page."""

from collections.abc import Iterator
from typing import NamedTuple

from contactlab.schema import StoreManifest, Sweep
from contactlab.store import Store

MOST_MISSED = 50


class Fact(NamedTuple):
    """One line of the head."""

    name: str
    text: str


class Missed(NamedTuple):
    """A run that did not come out as expected."""

    run: str
    label: str
    reason: str


def facts(store: Store) -> list[Fact]:
    """Return what was run, by what, where and when."""
    return list(_facts(store.manifest))


def _facts(manifest: StoreManifest) -> Iterator[Fact]:
    sweep, made = manifest.sweep, manifest.provenance
    revision = f", {made.git_revision[:12]}" if made.git_revision else ""
    yield Fact("scene", f"{sweep.scene} ({sweep.scene_hash})")
    yield Fact("runs", f"{manifest.runs:,} of {sweep.runs_asked:,}, {manifest.traces:,} traces")
    yield Fact("engine", f"{sweep.engine.name} {sweep.engine.version}")
    yield Fact("machine", f"{made.host.cpu_model}, {made.host.cores} cores, {made.host.os}")
    yield Fact("written by", f"contactlab {made.contactlab}{revision}, Python {made.python}")
    yield Fact("finished", manifest.finished[:16].replace("T", " ") + " UTC")
    if sweep.overrides:
        yield Fact("overrides", " ".join(sweep.overrides))


def verdict(manifest: StoreManifest) -> tuple[str, str]:
    """Return whether all is as expected (met, unmet or none), and that in words."""
    met, unmet = (manifest.expectations.get(name, 0) for name in ("met", "unmet"))
    if not met + unmet:
        return "none", "nothing was expected of these runs"
    if unmet:
        return "unmet", f"{unmet:,} of {met + unmet:,} runs are not as expected"
    return "met", f"{met:,} of {met:,} runs are as expected"


def expectations(store: Store) -> list[tuple[str, str, str]]:
    """Return what was expected: of which runs, what, and why."""
    sweep = Sweep.model_validate(store.manifest.sweep.resolved)
    found: list[tuple[str, str, str]] = []
    for each in sweep.expect:
        picks = [f"{name} = {value}" for name, value in each.where.settings.items()]
        picks += [each.where.where] if each.where.where else []
        wanted = [" or ".join(each.label)] if each.label else []
        wanted += [_bounds(name, bounds.min, bounds.max) for name, bounds in each.metrics.items()]
        found.append((", ".join(picks) or "all runs", "; ".join(wanted), each.reason or ""))
    return found


def _bounds(name: str, low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{low:g} ≤ {name} ≤ {high:g}"
    return f"{name} ≥ {low:g}" if low is not None else f"{name} ≤ {high:g}"


def missed(store: Store) -> list[Missed]:
    """Return the first runs that are not as expected."""
    if not store.manifest.expectations.get("unmet", 0):
        return []
    columns = store.columns.listed(["run_id", "label", "expectation_met", "expectation_reason"])
    rows = zip(*columns.values(), strict=True)
    found = (Missed(run, label, why or "") for run, label, met, why in rows if met is False)
    return [each for _, each in zip(range(MOST_MISSED), found, strict=False)]
