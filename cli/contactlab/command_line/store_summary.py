"""The summary of a store: its labels, expectations, and the axis values that fail."""

from typing import TYPE_CHECKING

from contactlab.command_line.declaration import Arguments
from contactlab.command_line.terminal import print_csv, print_document, print_json
from contactlab.errors import ContactlabError, ExpectationError, RunFailedError
from contactlab.printable import shell_word

if TYPE_CHECKING:
    from contactlab.store.finished_store import Store
    from contactlab.writers import Report


def summary_json(store: "Store", arguments: Arguments) -> None:
    """Print the manifest of a store."""
    del arguments
    manifest = store.manifest.model_dump(mode="json", exclude={"sweep"})
    print_json({"store": str(store.address), **manifest})


def explain_unexpected(store: "Store") -> ContactlabError | None:
    """Return the error of a store with lost runs, or runs that are not as its sweep expects."""
    from contactlab.judge.expectations import EXPECTED, MEANS, RUNS, expectation_findings

    failed = {finding.name: finding for finding in expectation_findings(store) if finding.failing}
    if RUNS in failed:
        return RunFailedError(failed[RUNS].message)
    if EXPECTED in failed:
        unmet = failed[EXPECTED].failing
        runs = store.manifest.runs
        return ExpectationError(f"{unmet} of {runs} runs are not as the sweep expects")
    return ExpectationError(failed[MEANS].message) if MEANS in failed else None


def summary_csv(store: "Store", arguments: Arguments) -> None:
    """Print the runs of a store: its columns of numbers and labels that have a value in any run."""
    del arguments
    columns = store.columns
    names = ["run_id", *columns.axis_names, "seed", "label", "label_reason", "expectation_met"]
    others = [name for name in columns.schema.names if columns.is_number(name)]
    column_names = [
        name for name in dict.fromkeys((*names, *others)) if columns.has_value(name).any()
    ]
    values = columns.to_pydict(column_names)
    print_csv([*values], zip(*values.values(), strict=True))


def summary_text(store: "Store", arguments: Arguments) -> None:
    """Print the result of a store: sentences, and the table of the axes that matter most."""
    del arguments
    from contactlab.reporting.store_document import describe_store

    print_document(describe_store(store))


def report_expectations(store: "Store", arguments: Arguments) -> "Report":
    """Return the report of the expectations of a sweep."""
    del arguments
    from contactlab.judge.conclusion import exit_code
    from contactlab.judge.expectations import expectation_findings
    from contactlab.reporting.finding import write_headline
    from contactlab.reporting.report_columns import read_run_labels
    from contactlab.writers import Report

    findings, name = tuple(expectation_findings(store)), store.manifest.sweep.name
    return Report(
        title=f"contactlab sweep {name}",
        place=(name,),
        headline=f"{name}: {write_headline(read_run_labels(store))}",
        passed=exit_code(findings) == 0,
        record=store.manifest,
        findings=findings,
        commands=(("look closer", f"contactlab show {shell_word(store.address)}"),),
    )
