"""Run sweeps and studies."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from contactlab.api.reading_functions import address_of
from contactlab.pareto.criteria import Criteria
from contactlab.plan.overrides import Overrides, drive_option
from contactlab.plugins import load_plugins
from contactlab.resources import RESULTS, find_sweep
from contactlab.run.sweep_request import read_request
from contactlab.run.worker_pool import worker_count
from contactlab.schema.check_report import CheckReport, StabilityReport, TaskKind
from contactlab.schema.effects_report import EffectsReport
from contactlab.schema.judged_check import AcceptedCheck
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store
from contactlab.store.store_address import Address, parse_address
from contactlab.studies import stability_cases, tradeoff_sweep
from contactlab.studies.check import model_check
from contactlab.studies.effects import ablation
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.studies.session import Session, model_name

Settings = Mapping[str, object] | Sequence[str]
"""Settings by name, such as `{"timestep": [1e-3, 2e-3]}`, or options as typed, `timestep=1e-3`."""

Progress = Callable[[int, int], None]
"""Called with the runs done and the runs in all, as they finish."""


def sweep(
    source: str | Path | Mapping[str, object],
    *,
    output: str | Address | None = None,
    set: Settings = (),
    only: Settings = (),
    limit: int | None = None,
    drive: str | None = None,
    workers: int | None = None,
    fresh: bool = False,
    retry_failed: bool = False,
    repair: bool = False,
    plugins: Sequence[str | Path] = (),
    allow_code: bool = False,
    progress: Progress | None = None,
) -> Store:
    """Run a sweep into a store, or resume it, and open the store.

    Args:
        source: a sweep file, the name of a shipped sweep, or what a sweep file would say, as data.
        output: the store, a folder or an address; `results/NAME` if left out.
        set: axes or keys to replace.
        only: axis values; runs with other values are left out.
        limit: the first so many runs only.
        drive: what drives the runs, as `--drive` takes it.
        workers: worker processes, 0 for none; one for each core if left out.
        fresh: whether to replace a store that is there.
        retry_failed: whether stored runs that crashed, timed out or failed are run again.
        repair: whether stored runs that are damaged are run again.
        plugins: files that add metrics, labels, oracles or engines. They are executed.
        allow_code: whether a policy that drives the runs may be executed.
        progress: called as runs finish.

    Raises:
        SweepFileError: the sweep or a setting holds mistakes; all are named.
        OutputError: the store cannot be written.
        StoreError: the store is another sweep's.
        StoppedError: the sweep was interrupted; the same call resumes it.
    """
    load_plugins([Path(each) for each in plugins])
    if isinstance(source, Mapping):
        name, text, folder = "sweep", source, Path()
    else:
        text = find_sweep(str(source))
        name, folder = text.stem, text.parent
    request = read_request(
        text,
        name,
        RESULTS / name if output is None else parse_address(output),
        folder=folder,
        workers=worker_count(workers),
        overrides=Overrides(_assigned(set), _assigned(only), limit),
        drive=drive_option(drive),
        fresh=fresh,
        retry_failed=retry_failed,
        repair=repair,
    )
    return _session(Path(), workers, progress, allow_code=allow_code).run(request)


def check(
    model: str | Path,
    *,
    set: Settings = (),
    only: Sequence[str] = (),
    output: str | Path | None = None,
    keyframe: str | None = None,
    kind: TaskKind | Literal["auto"] = "auto",
    drive: str | None = None,
    limits: Mapping[str, float] | None = None,
    accept: Sequence[AcceptedCheck] = (),
    remedies: bool = True,
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    allow_code: bool = False,
    progress: Progress | None = None,
) -> CheckReport:
    """Check a model before it is trusted: six checks with their numbers, and what helps.

    Args:
        model: a shipped scene, a folder, an .xml or .urdf file, or `menagerie:ROBOT`.
        set: settings to check it with.
        only: names of checks; all if empty.
        output: the folder of its evidence; `results/check/NAME` if left out.
        keyframe: where runs start; `qpos0` is the model's own start.
        kind: of task, which decides what the timestep has to suit.
        drive: what drives it, as `--drive` has it; of a bare model an exercise if left out.
        limits: limits that replace those of the checks, by the name of the measure.
        accept: findings that are known and accepted.
        remedies: whether to look for changes that help.
        workers: worker processes, 0 for none; one for each core if left out.
        plugins: files that add metrics, labels, oracles or engines. They are executed.
        allow_code: whether a policy that drives the runs may be executed.
        progress: called as runs finish.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: a setting, or the name of a check or a limit, is wrong.
        PolicyError: what is accepted is not a finding of any check.
    """
    load_plugins([Path(each) for each in plugins])
    start = [f"keyframe={keyframe}"] if keyframe else []
    request = model_check.CheckRequest(
        model=str(model),
        assign=[*_assigned(set), *start],
        only=only,
        kind=None if kind == "auto" else kind,
        drive=drive_option(drive),
        limits=limits or {},
        accepted=accept,
        remedies=remedies,
    )
    folder = Path(output or RESULTS / "check" / model_name(str(model)))
    return model_check.run(request, _session(folder, workers, progress, allow_code=allow_code))


def effects(
    source: str | Path,
    *,
    set: Settings = (),
    seeds: int = 6,
    drive: str | None = None,
    output: str | Path | None = None,
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    allow_code: bool = False,
    progress: Progress | None = None,
) -> EffectsReport:
    """Find which effects a scene needs, what each costs, and the smallest set that will do.

    Args:
        source: a scene, a sweep file or a model.
        set: settings of the base configuration.
        seeds: how many seeds to change effects with.
        drive: what drives the runs, as `--drive` takes it.
        output: the folder of its evidence; `results/effects/NAME` if left out.
        workers: worker processes, 0 for none; one for each core if left out.
        plugins: files that add metrics, labels, oracles or engines. They are executed.
        allow_code: whether a policy that drives the runs may be executed.
        progress: called as runs finish.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep or a setting is wrong.
    """
    load_plugins([Path(each) for each in plugins])
    request = EffectsRequest(str(source), _assigned(set), seeds, drive=drive_option(drive))
    folder = Path(output or RESULTS / "effects" / model_name(str(source)))
    return ablation.run(request, _session(folder, workers, progress, allow_code=allow_code))


def stability(
    names: Sequence[str | Path] = (),
    *,
    drive: str | None = None,
    output: str | Path = RESULTS / "stability",
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    allow_code: bool = False,
    progress: Progress | None = None,
) -> StabilityReport:
    """Run hard cases, or generic checks of models.

    Args:
        names: cases of the catalogue, or models; the whole catalogue if empty.
        drive: what drives the runs, as `--drive` takes it.
        output: the folder of the stores, one a case.
        workers: worker processes, 0 for none; one for each core if left out.
        plugins: files that add metrics, labels, oracles or engines. They are executed.
        allow_code: whether a policy that drives the runs may be executed.
        progress: called as runs finish.

    Raises:
        SweepFileError: there is no such case.
    """
    load_plugins([Path(each) for each in plugins])
    request = stability_cases.StabilityRequest([str(each) for each in names], drive_option(drive))
    return stability_cases.run(
        request, _session(Path(output), workers, progress, allow_code=allow_code)
    )


def tradeoff(
    source: Store | str | Address,
    *,
    error: str | None = None,
    tolerance: Mapping[str, float] | None = None,
    drive: str | None = None,
    output: str | Address | None = None,
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    allow_code: bool = False,
    progress: Progress | None = None,
) -> TradeoffReport:
    """Find what accuracy costs in time, and the cheapest configuration that will do.

    Args:
        source: a store; or a sweep file, the name of a shipped sweep, a model file or
            menagerie:ROBOT, which are then run.
        error: what measures accuracy: `error_final`, `oracle_error` or any metric.
        tolerance: largest acceptable values by metric, over those of the sweep.
        drive: what drives the runs of a sweep, as `--drive` takes it.
        output: the store of a sweep; `results/tradeoff/NAME` if left out.
        workers: worker processes, 0 for none; one for each core if left out.
        plugins: files that add metrics, labels, oracles or engines. They are executed.
        allow_code: whether a policy that drives the runs may be executed.
        progress: called as runs finish.

    Raises:
        SweepFileError: the sweep holds mistakes, or a tolerance names what it does not measure.
        StoreError: the store has no error to evaluate.
    """
    load_plugins([Path(each) for each in plugins])
    request = tradeoff_sweep.TradeoffRequest(
        str(address_of(source)),
        Criteria(error, tolerance or {}),
        None if output is None else parse_address(output),
        drive_option(drive),
    )
    return tradeoff_sweep.run(
        request, _session(RESULTS / "tradeoff", workers, progress, allow_code=allow_code)
    )


def _session(
    folder: Path, workers: int | None, progress: Progress | None, *, allow_code: bool
) -> Session:
    done = total = 0

    def advance(runs: int) -> None:
        nonlocal done
        done += runs
        if progress is not None:
            progress(done, total)

    def begin(runs: int, stored: int) -> None:
        nonlocal total
        total = runs
        advance(stored - done)

    def add(finished: Sequence[object]) -> None:
        advance(len(finished))

    return Session(folder, worker_count(workers), begin, add, allow_code=allow_code)


def _assigned(settings: Settings) -> list[str]:
    """Return settings as the command line has them: `NAME=VALUE,VALUE`."""
    if not isinstance(settings, Mapping):
        return list(settings)
    listed = {
        name: value if isinstance(value, list | tuple) else [value]
        for name, value in settings.items()
    }
    return [f"{name}={','.join(map(json.dumps, values))}" for name, values in listed.items()]
