"""`contactlab lock`: freeze outcomes, and check them; `bisect`: which release changed them."""

from collections.abc import Sequence
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path

import typer

from contactlab.commands import options as opt
from contactlab.commands.compare_command import (
    ReportFormat,
    files_to_write,
    policy_of,
    print_report,
    publish,
)
from contactlab.commands.options import flag, helped, option
from contactlab.commands.terminal import echo, print_json, say
from contactlab.errors import ExpectationError, OutputError, StoreError, SweepFileError

_POLICY = option("FILE", "Policy file of compare: what counts, and how far it may change.")


@helped(
    "lock sweeps/gripper.yaml",
    "lock sweeps/gripper.yaml --check -o lock.xml",
    "lock sweeps/gripper.yaml --check --set seeds=[10,11,12]",
    codes="0 written or as locked, 1 an outcome changed, 2 bad input, 3 it cannot be judged",
)
def lock(
    source: str = typer.Argument(..., metavar="SWEEP|STORE", help="Sweep, or a finished store."),
    file: Path | None = option("FILE", "The lock; by default NAME.lock.yaml beside the sweep."),
    policy: Path | None = _POLICY,
    assign: list[str] | None = opt.SET,
    workers: int | None = opt.WORKERS,
    mujoco: str | None = opt.MUJOCO,
    files: list[Path] | None = opt.output_option(
        "FILE", "Report of the check: .md, .json, .xml (JUnit) or .txt; may be repeated."
    ),
    output: ReportFormat = opt.FORMAT,
    *,
    allow_code: bool = opt.ALLOW_CODE,
    check: bool = flag("--check", "Check instead: exit with 1 if an outcome is not as locked."),
    chaotic: bool = flag("--chaotic", "Other machines cannot repeat it: judge by spread alone."),
) -> None:
    """Freeze what a sweep gives in a small file, or check that it still does."""
    from contactlab.store.finished_store import Store
    from contactlab_lock.judgement import judge
    from contactlab_lock.lock_file import gated_metrics, lock_of, read, write
    from contactlab_lock.versions import run_sweep

    if files and not check:
        raise OutputError("-o writes the report of --check; name the lock itself by --file")
    rules, targets = policy_of(policy, {}), files_to_write(files or [])
    given, store = _given(assign, workers, allow_code=allow_code), Path(source)
    path = file or store.with_name(f"{store.stem}.lock.yaml")
    known = read(path) if check else None
    if not (store / "manifest.json").is_file():
        store = Path("results", "lock", store.stem)
        run_sweep(source, store, mujoco, [*given, "--fresh"], say)
    elif given or mujoco:
        raise SweepFileError(f"{source} is a store; --set, --workers and --mujoco are for sweeps")
    opened = Store.open(store)
    if known is None:
        made = lock_of(opened, gated_metrics(opened, rules), chaotic=chaotic)
        write(path, made, source)
        echo(f"{path} holds the outcomes of {opened.manifest.runs} runs of {store}")
        how = [f"--file {file}"] if file else []
        how += ["--allow-code"] if allow_code else []
        echo(" ".join([f"check them: contactlab lock {source} --check", *how]))
        return
    report = judge(known, str(path), opened, rules)
    publish(report, targets)
    print_report(report, output)
    if report.exit_code:
        failed = report.exit_code == ExpectationError.exit_code
        raise (ExpectationError if failed else StoreError)(report.headline)


@helped(
    "bisect tower.yaml --good 3.11.0 --bad 4.0.0",
    "bisect tests/test_grasp.py::test_held --good 3.11.0 --bad 4.0.0",
    codes="0 found, 1 both ends give the same, 2 bad input, 130 interrupted: the same resumes it",
)
def bisect(
    source: str = typer.Argument(
        ..., metavar="SWEEP|TEST", help="Sweep, or a test of pytest: tests/test_a.py::test_b."
    ),
    good: str = typer.Option(..., metavar="VERSION", help="Release that gives the old outcome."),
    bad: str = typer.Option(..., metavar="VERSION", help="Release that gives another."),
    question: list[str] | None = option(
        "CHECK", "Ask for a check of compare: 'slip_distance unchanged'; may be repeated."
    ),
    versions: str | None = option("A,B,...", "Releases to try; by default all that pip finds."),
    policy: Path | None = _POLICY,
    assign: list[str] | None = opt.SET,
    workers: int | None = opt.WORKERS,
    folder: Path | None = opt.output_option("FOLDER", "Folder for what each release gives."),
    output: opt.Format = opt.FORMAT,
    *,
    allow_code: bool = opt.ALLOW_CODE,
) -> None:
    """Find the release of MuJoCo that changed an outcome; the same command resumes."""
    from contactlab.comparison.checks import plural
    from contactlab_lock import bisection
    from contactlab_lock.versions import releases, run_sweep, run_test

    listed = releases(good, bad, (versions or "").split(",") if versions else ())
    is_test = "::" in source
    name = source.rpartition("::")[2] if is_test else Path(source).stem
    place = folder or Path("results", "bisect", name)
    given = tuple(_given(assign, workers, allow_code=allow_code))
    subject = bisection.SweepOutcomes(
        place,
        cache(partial(run_sweep, source, given=given, notify=say)),
        policy_of(policy, {}),
        question or (),
    )

    def passes(version: str) -> bool:
        run = partial(run_test, source, place / version, version, say)
        return bisection.remembered(source, place / version, run)

    if is_test:
        if passes(good) == passes(bad):
            raise ExpectationError(f"{source} ends the same with {good} and {bad}; see {place}")
        found = bisection.bisect(listed, lambda each: passes(each) != passes(good), say)
    else:
        subject.begin(good, bad)
        found = bisection.bisect(listed, subject.differs, say)
    report = None if is_test else subject.shown(found)
    if output == "json":
        compared = report and report.model_dump(mode="json")
        print_json({**asdict(found), "comparison": compared, "folder": str(place)})
        return
    tried = plural(found.steps, "release")
    echo(f"MuJoCo {found.after} changed it, after {found.before} ({tried} between the ends tried)")
    for version, reason in found.skipped.items():
        echo(f"or {version}, which cannot be run: {reason}")
    if report is not None:
        print_report(report, "text")
    else:
        echo(f"what pytest printed: {place / found.after / 'pytest.txt'}")


def _given(assign: Sequence[str] | None, workers: int | None, *, allow_code: bool) -> list[str]:
    """Return the options that are those of `sweep`."""
    count = [] if workers is None else [f"--workers={workers}"]
    allowed = ["--allow-code"] if allow_code else []
    return [*(f"--set={each}" for each in assign or ()), *count, *allowed]
