"""`contactlab merge`: join shards of a sweep into one store."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, Option, command, flag
from contactlab.command_line.store_summary import (
    summary_csv,
    summary_json,
    summary_text,
    unexpected,
)
from contactlab.command_line.surroundings import say
from contactlab.errors import ContactlabError

if TYPE_CHECKING:
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


def _failure(result: "Store", given: Given) -> ContactlabError | None:
    del given
    return unexpected(result)


@command(
    "run",
    examples=(
        "merge shards/* -o results/grasp",
        "merge s3://lab/grasp/1 s3://lab/grasp/2 -o grasp",
    ),
    formats={"text": summary_text, "json": summary_json, "csv": summary_csv},
    failure=_failure,
)
def merge(
    places: Annotated[
        "Sequence[Address | str]",
        Argument("PLACE...", "Stores of `sweep --shard`, in any order.", kind=list[str]),
    ],
    *,
    output: Annotated[
        "Address | str",
        Option("STORE", "Store to write: a folder or s3://BUCKET/PREFIX.", kind=str, short="-o"),
    ],
    partial: Annotated[
        bool, flag("Merge the shards that exist, and list the missing runs.")
    ] = False,
    fresh: Annotated[bool, flag("Replace an existing store.")] = False,
) -> "Store":
    """Join the shards of a sweep into one store.

    Raises:
        StoreError: a place is unfinished, of another sweep, or has runs that another has; or runs
            are missing.
        OutputError: the store cannot be written, or there is one.
    """
    from contactlab.run.merged_stores import merge_stores
    from contactlab.store.finished_store import Store

    target = opt.address_of(output)
    gaps = merge_stores(
        [opt.address_of(place) for place in places], target, may_lack=partial, fresh=fresh
    )
    if gaps:
        say(gaps)
    return Store.open(target)
