"""The comparison of two stores as a report: its stores, runs, changed labels and checks."""

from collections.abc import Collection, Iterable, Iterator

from contactlab.judge.policies import REMEASURED
from contactlab.judge.wording import plural
from contactlab.mjcf import attribute_of
from contactlab.schema.comparison import ComparedStore, ComparisonReport
from contactlab.writers.report import Report


def report_of(compared: ComparisonReport) -> Report:
    """Return a comparison as a report to write."""
    sweep = compared.baseline.sweep if compared.baseline else "stores"
    commands = (advice.partition(": ") for advice in compared.advice)
    return Report(
        title=f"contactlab {sweep}" if compared.baseline else "contactlab compare",
        place=(sweep,),
        headline=compared.headline,
        passed=compared.exit_code == 0,
        record=compared,
        facts=tuple(_report_facts(compared)),
        findings=compared.findings,
        commands=tuple((what, command) for what, _, command in commands),
        lists_passed=False,
    )


def explain_no_effect(axes: Iterable[str], quantities: Collection[str]) -> str:
    """Say that a change of the model acts in no run, and why.

    Args:
        axes: the axes of the sweep.
        quantities: the changed quantities of the model, by their attributes.
    """
    hiding = [axis for axis in axes if attribute_of(axis) in quantities]
    if not hiding:
        why = "no run uses a changed value"
        if "friction" in quantities:
            why += ": the geoms touch nothing, or the other geom of each contact has more friction"
        return f"the change of the model acts in no run, because {why}"
    hidden = ", ".join(dict.fromkeys(map(attribute_of, hiding)))
    word = "axis" if len(hiding) == 1 else "axes"
    hiding_text = f"the {word} {', '.join(hiding)} {'sets' if len(hiding) == 1 else 'set'} {hidden}"
    return (
        f"the change of the model acts in no run, because {hiding_text} in every run; "
        f"sweep without {'it' if len(hiding) == 1 else 'them'} to judge the change"
    )


def _report_facts(compared: ComparisonReport) -> Iterator[tuple[str, str]]:
    if compared.baseline is None or compared.candidate is None:
        return
    # Changes of the model, the settings and the engine come before their consequences.
    most_shown = 4
    shown_changes = compared.model_changes[:most_shown]
    for place, change in enumerate(shown_changes):
        yield "" if place else "changed", change
    if more := len(compared.model_changes) - len(shown_changes):
        one, other = (store.store for store in (compared.baseline, compared.candidate) if store)
        yield "", f"and {more} more: contactlab diff {one} {other}"
    for difference in compared.differences:
        if difference.what not in ("scene_hash", "cpu_model", "cpu_flags"):
            change = f"{difference.baseline} -> {difference.candidate}"
            yield f"{difference.what}", change
    if compared.baseline.physics == compared.candidate.physics:
        yield "physics", "the same in all runs"
    yield "baseline", _store_summary(compared.baseline)
    yield "candidate", _store_summary(compared.candidate)
    if compared.control is not None:
        yield "control", _store_summary(compared.control)
    yield "runs", _run_summary(compared)
    for transition in compared.transitions:
        moved = f"{transition.baseline} -> {transition.candidate}"
        yield "label", f"{moved}: {plural(transition.runs)}"
    for finding in compared.findings:
        # A reader who asked for these wants more than the verdict.
        if finding.outcome == "passed" and finding.kind == "outcomes":
            yield "outcomes", f"{finding.name}: {finding.message}"
        if finding.outcome == "passed" and finding.name.startswith(REMEASURED):
            yield "time", f"{finding.name}: {finding.message}"


def _run_summary(compared: ComparisonReport) -> str:
    if compared.match == "none":
        return "not paired"
    pairs = compared.pairs
    parts = [f"{pairs.paired:,} paired by {compared.match}"]
    equal = "all" if pairs.bitwise_equal == pairs.paired else f"{pairs.bitwise_equal:,}"
    parts.append(f"{equal} bitwise equal")
    parts += [f"{pairs.missing:,} missing"] if pairs.missing else []
    parts += [f"{pairs.new:,} new"] if pairs.new else []
    parts += ["judged together, with 95 % intervals"] if compared.judge == "spread" else []
    if pairs.knife_edge:
        flipped = f" ({pairs.knife_edge_flipped:,} with another label now)"
        parts.append(f"{pairs.knife_edge:,} knife-edge{flipped}")
    return ", ".join(parts)


def _store_summary(store: ComparedStore) -> str:
    revision = f", {store.git_revision[:12]}" if store.git_revision else ""
    return (
        f"{store.store}: {store.sweep}, {plural(store.runs)}, {store.engine}, "
        f"contactlab {store.contactlab}, {store.finished[:16].replace('T', ' ')}{revision}"
    )
