"""`contactlab show`: the record of a run, or the summary of a store."""

from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, command
from contactlab.command_line.report_formats import formats_by_type
from contactlab.command_line.store_summary import (
    summary_csv,
    summary_json,
    summary_text,
)
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import print_csv, print_document, print_report_json
from contactlab.errors import StoreError

if TYPE_CHECKING:
    from contactlab.schema.evidence import EvidenceRecord
    from contactlab.store.finished_store import Store


def _run_text(record: "EvidenceRecord", arguments: Arguments) -> None:
    from contactlab.reporting.run_document import describe_run
    from contactlab.store.finished_store import Store

    print_document(describe_run(Store.open(opt.address_of(arguments["store"])), record))


def _run_csv(record: "EvidenceRecord", arguments: Arguments) -> None:
    del arguments
    rows = [(name, value, record.units.get(name)) for name, value in record.metrics.items()]
    print_csv(("metric", "value", "unit"), rows)


@command(
    "read",
    examples=(
        "show results/grasp",
        "show results/grasp 3ead3115",
        "show results/grasp --format csv",
    ),
    formats=formats_by_type(
        {
            "Store": {"text": summary_text, "json": summary_json, "csv": summary_csv},
            "EvidenceRecord": {"text": _run_text, "json": print_report_json, "csv": _run_csv},
        }
    ),
)
def show(
    store: opt.StoreArgument,
    run: Annotated[
        str | None, Argument("RUN", "Run id, or its first digits; the whole store by default.")
    ] = None,
) -> "Store | EvidenceRecord":
    """Show the record of a run, or the summary of a store.

    It is returned: the record, or the open store.

    Raises:
        StoreError: there is no such store or run, or it is damaged.
    """
    from contactlab.store.finished_store import Store

    opened = Store.open(opt.address_of(store))
    if run is None:
        opt.mention_damage(opened)
        return opened
    record = opened.record(run)
    if record.trace is not None and not opened.manifest.traces_left_out:
        try:
            opened.trace(record)
        except StoreError as error:
            say(f"warning: {error}")
    return record
