"""`contactlab lock`: freeze outcomes, and check that they still hold."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
from contactlab.command_line.surroundings import say
from contactlab.errors import ContactlabError, OutputError, SweepFileError
from contactlab.printable import shell_word

if TYPE_CHECKING:
    from contactlab.schema.comparison import ComparisonReport
    from contactlab.schema.store_reports import WrittenLock


def _find_failure(
    result: "WrittenLock | ComparisonReport", arguments: Arguments
) -> ContactlabError | None:
    from contactlab.schema.store_reports import WrittenLock

    return None if isinstance(result, WrittenLock) else find_failure(result, arguments)


@command(
    "gate",
    keeps="finished runs",
    examples=(
        "lock sweeps/gripper.yaml",
        "lock sweeps/gripper.yaml --check -o lock.xml",
        "lock sweeps/gripper.yaml --check --set seeds=[10,11,12]",
    ),
    codes="0 written or unchanged, 1 an outcome changed, 2 bad input, 3 it cannot be judged",
    formats=formats_by_type(
        {"ComparisonReport": list_printers(report_comparison), "WrittenLock": report_formats()}
    ),
    failure=_find_failure,
)
def lock(
    source: Annotated[str | Path, Argument("SWEEP|STORE", "Sweep, or a finished store.", kind=str)],
    *,
    file: Annotated[
        str | Path | None,
        Option("FILE", "The lock; by default NAME.lock.yaml next to the sweep.", kind=Path),
    ] = None,
    policy: opt.Policy = None,
    set: opt.Set = (),
    workers: opt.Workers = None,
    mujoco: opt.Mujoco = None,
    output: opt.ReportFiles = (),
    allow_code: opt.AllowCode = False,
    check: Annotated[
        bool, flag("Check the lock instead; exit with 1 if an outcome changed.")
    ] = False,
    chaotic: Annotated[
        bool, flag("The motion is chaotic: judge outcomes by their spread only.")
    ] = False,
) -> "WrittenLock | ComparisonReport":
    """Freeze the outcomes of a sweep in a file, or check them.

    The lock is returned, or with `check` the comparison with it.

    Raises:
        StoreError: there is no lock to check, or a store is damaged.
        SweepFileError: the sweep or a setting holds mistakes.
        OutputError: a file cannot be written.
    """
    from contactlab.resources import find_sweep
    from contactlab.schema.store_reports import WrittenLock
    from contactlab.store.finished_store import Store
    from contactlab.studies.lock.judgement import judge_lock
    from contactlab.studies.lock.lock_file import gated_metrics, lock_of, read_lock, write_lock
    from contactlab.studies.lock.versions import run_sweep

    if output and not check:
        raise OutputError("-o writes the report of --check; name the lock itself by --file")
    rules, targets = policy_of(policy), files_to_write(output)
    sweep_options, store = (
        sweep_words(opt.write_assignments(set), workers, allow_code=allow_code),
        Path(source),
    )
    path = Path(file) if file else store.with_name(f"{store.stem}.lock.yaml")
    stored_lock = read_lock(path) if check else None
    if not (store / "manifest.json").is_file():
        find_sweep(str(source))
        store = Path("results", "lock", store.stem)
        run_sweep(str(source), store, mujoco, [*sweep_options, "--fresh"], say)
    elif sweep_options or mujoco:
        raise SweepFileError(f"{source} is a store; --set, --workers and --mujoco are for sweeps")
    opened = Store.open(store)
    if stored_lock is None:
        new_lock = lock_of(opened, gated_metrics(opened, rules), chaotic=chaotic)
        write_lock(path, new_lock, str(source))
        options = [f"--file {shell_word(path)}"] if file else []
        options += ["--allow-code"] if allow_code else []
        check_it = " ".join([f"contactlab lock {shell_word(source)} --check", *options])
        return WrittenLock(file=path, store=store, runs=opened.manifest.runs, check=check_it)
    report = judge_lock(stored_lock, str(path), opened, rules)
    publish(report, targets)
    return report


def sweep_words(settings: Sequence[str], workers: int | None, *, allow_code: bool) -> list[str]:
    """Return the options for `sweep`, in the form of its command line."""
    count = [] if workers is None else [f"--workers={workers}"]
    allowed = ["--allow-code"] if allow_code else []
    return [*(f"--set={setting}" for setting in settings), *count, *allowed]
