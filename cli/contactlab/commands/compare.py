"""`contactlab compare`: whether a store is worse than another."""

import sys
from datetime import date, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command, flag
from contactlab.command_line.judgements import (
    files_to_write,
    find_failure,
    list_printers,
    policy_of,
    publish,
    report_comparison,
)
from contactlab.command_line.report_formats import formats_by_type, report_formats
from contactlab.errors import ContactlabError, OutputError, PolicyError, StoreError

if TYPE_CHECKING:
    from contactlab.comparison.metric_checks import Remeasure
    from contactlab.schema.comparison import ComparisonReport
    from contactlab.schema.store_reports import WrittenBaseline
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


def _find_failure(
    result: "ComparisonReport | WrittenBaseline", arguments: Arguments
) -> ContactlabError | None:
    from contactlab.schema.store_reports import WrittenBaseline

    return None if isinstance(result, WrittenBaseline) else find_failure(result, arguments)


@command(
    "gate",
    keeps="nothing",
    examples=(
        "compare results/before results/after",
        "compare baselines/grasp results/grasp --update",
    ),
    formats=formats_by_type(
        {"ComparisonReport": list_printers(report_comparison), "WrittenBaseline": report_formats()}
    ),
    failure=_find_failure,
)
def compare(
    baseline: Annotated[
        "Store | Address | str", Argument("BASELINE", "Store to compare with.", kind=str)
    ],
    candidate: Annotated[
        "Store | Address | str", Argument("CANDIDATE", "Store to judge.", kind=str)
    ],
    *,
    policy: opt.Policy = None,
    match: Annotated[
        Literal["id", "axes", "none"] | None,
        Option(None, "Pair runs by id, by axis values and seed, or not: outcomes alone."),
    ] = None,
    control: Annotated[
        "Store | Address | str | None",
        Option("STORE", "The baseline once more, made as the candidate was.", kind=str),
    ] = None,
    output: opt.ReportFiles = (),
    update: Annotated[
        bool,
        flag("Write the candidate as the baseline, without its traces, to commit."),
    ] = False,
    thorough: Annotated[bool, flag("Verify every record and every trace first.")] = False,
    baseline_digest: opt.BaselineDigest = None,
    remeasure: Annotated[
        int | None, Option("N", "Time N pairs of runs again, interleaved.", least=1)
    ] = None,
    baseline_python: Annotated[
        str | Path | None,
        Option(None, "Python that times the baseline's runs; by default this one.", kind=Path),
    ] = None,
    candidate_python: Annotated[
        str | Path | None,
        Option(None, "Python that times the candidate's runs; by default this one.", kind=Path),
    ] = None,
    waive: Annotated[
        str | None, Option("CHECK", "Waive a failed check: add it to the policy file.")
    ] = None,
    reason: Annotated[str, Option(None, "Why the check is waived.")] = "",
    until: Annotated[
        date | None,
        Option(None, "Last day of the waiver.", kind=datetime, formats=("%Y-%m-%d",)),
    ] = None,
) -> "ComparisonReport | Any":  # noqa: ANN401 - so that a caller without `update` has a report
    """Compare a store with a baseline; exit with 1 if a gate fails.

    With `update` nothing is compared: the baseline is written, and the result is a WrittenBaseline.
    The policy defines regressions, gates and, without `match`, the pairing of runs. The engine is
    loaded only to time runs again. With a control, outcomes of the candidate are compared with
    those of the control.

    Raises:
        StoreError: a store is not sound, or the stores have no run in common.
        PolicyError: the policy names something that the stores do not have.
        OutputError: the baseline cannot be written.
    """
    if all(Path(str(each)).suffix in {".xml", ".urdf"} for each in (baseline, candidate)):
        raise StoreError(f"compare reads stores; models: contactlab diff {baseline} {candidate}")
    if update:
        from contactlab.schema.store_reports import WrittenBaseline
        from contactlab.store.verify_store import write_baseline

        folder, source = opt.address_of(baseline), opt.address_of(candidate)
        if not isinstance(folder, Path):
            raise OutputError(f"{baseline}: --update writes a folder; name one")
        new_baseline = write_baseline(source, folder, baseline_digest)
        return WrittenBaseline(
            store=str(source),
            baseline=str(folder),
            runs=new_baseline.manifest.runs,
            bytes=sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()),
            digest=new_baseline.digest,
        )
    from contactlab.comparison.compare_stores import compare_stores, unreadable_report
    from contactlab.judge.waivers import add_waivers, waivers_for

    targets = files_to_write(output)
    overrides = {"match": match, "baseline_digest": baseline_digest}
    timers = _read_timers(remeasure, baseline_python, candidate_python)
    stores = opt.address_of(baseline), opt.address_of(candidate)
    arm = None if control is None else opt.address_of(control)
    run = partial(compare_stores, *stores, control=arm, thorough=thorough, remeasure=timers)
    if waive is not None:
        if policy is None:
            raise PolicyError("--waive adds to a policy file; name it with --policy FILE")
        before = run(policy_of(policy if Path(policy).exists() else None, overrides))
        day = until.date() if isinstance(until, datetime) else until
        add_waivers(Path(policy), waivers_for(before.findings, waive, reason, day))
    rules = policy_of(policy, overrides)
    try:
        report = run(rules)
    except StoreError as error:
        publish(unreadable_report(error, rules), targets)
        raise
    if any(difference.what == "scene_hash" for difference in report.differences):
        from contactlab.comparison.report import explain_no_effect
        from contactlab.rendering.amounts import format_percent
        from contactlab.store.finished_store import Store
        from contactlab.studies.diff.compare_models import DEFAULT_TOLERANCE, summarize_changes

        changes, quantities = summarize_changes(*map(str, stores))
        least = format_percent(DEFAULT_TOLERANCE)
        no_change = (f"the files of the model, but no value of it by more than {least}",)
        added: dict[str, object] = {"model_changes": tuple(changes) or no_change}
        if report.pairs.bitwise_equal == report.pairs.paired > 0 and changes:
            axes = Store.open_unchecked(stores[1]).columns.axis_names
            added["headline"] = f"{report.headline}; {explain_no_effect(axes, quantities)}"
        report = report.model_copy(update=added)
    publish(report, targets)
    return report


def _read_timers(
    runs: int | None, baseline_python: str | Path | None, candidate_python: str | Path | None
) -> "Remeasure | None":
    if runs is None:
        if baseline_python or candidate_python:
            raise PolicyError("--baseline-python and --candidate-python need --remeasure N")
        return None
    from contactlab.comparison.metric_checks import Remeasure
    from contactlab.run.stored_runs import timing_process

    pythons = (Path(python or sys.executable) for python in (baseline_python, candidate_python))
    return Remeasure(runs, *(partial(timing_process, python) for python in pythons))
