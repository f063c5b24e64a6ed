"""`contactlab verify`: whether a store is complete and unchanged."""

from contactlab.commands.options import FormatOption, StoreArgument, mention_plugins
from contactlab.commands.terminal import echo, print_json
from contactlab.errors import StoreError
from contactlab.printable import in_one_line


def verify(
    store: StoreArgument,
    output: FormatOption = "text",
) -> None:
    """Check every file of a store against its hash, its schema and its structure."""
    from contactlab.store.finished_store import Store
    from contactlab.store.verify_store import verify as find_problems

    problems = find_problems(store)
    manifest = Store.open(store).manifest
    mention_plugins(store, manifest.sweep.plugins)
    if output == "json":
        print_json({"sound": not problems, "problems": problems, "runs": manifest.runs})
    elif not problems:
        left_out = " left out" if manifest.traces_left_out else ""
        echo(f"{store} is sound: {manifest.runs} runs, {manifest.traces} traces{left_out}")
    else:
        for problem in problems:
            echo(in_one_line(problem))
    if problems:
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        raise StoreError(f"{store} is not sound: {count}")
