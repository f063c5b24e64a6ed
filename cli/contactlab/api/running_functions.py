"""Run sweeps and studies. All functions take `RunOptions` by keyword, too."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypedDict, Unpack

from contactlab.api.reading_functions import address_of
from contactlab.pareto.criteria import Criteria
from contactlab.plan.overrides import Overrides, drive_option
from contactlab.plugins import load_plugins
from contactlab.resources import RESULTS, find_sweep
from contactlab.run.sweep_request import read_request
from contactlab.run.worker_pool import worker_count
from contactlab.schema.check_report import CheckReport, StabilityReport, TaskKind
from contactlab.schema.comparison import AcceptedCheck
from contactlab.schema.study_reports import EffectsReport
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store
from contactlab.store.store_files import Address, parse_address
from contactlab.studies import stability_cases, tradeoff_sweep
from contactlab.studies.check import model_check
from contactlab.studies.effects import ablation
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.studies.session import Session, model_name

Settings = Mapping[str, object] | Sequence[str]
"""Settings by name, such as `{"timestep": [1e-3, 2e-3]}`, or options as typed, `timestep=1e-3`."""

Progress = Callable[[int, int], None]
"""Called with the runs done and the runs in all, as they finish."""


class RunOptions(TypedDict, total=False):
    """How runs are made, whatever they are for."""

    workers: int | None  # worker processes, 0 for none; one for each core if left out
    # Files that add metrics, labels, oracles or engines. They are executed.
    plugins: Sequence[str | Path]
    allow_code: bool  # whether a policy, or an environment, may be executed
    progress: Progress | None  # called as runs finish


def sweep(
    source: str | Path | Mapping[str, object],
    *,
    output: str | Address | None = None,
    set: Settings = (),
    only: Settings = (),
    limit: int | None = None,
    drive: str | None = None,
    fresh: bool = False,
    retry_failed: bool = False,
    repair: bool = False,
    **options: Unpack[RunOptions],
) -> Store:
    """Run a sweep into a store, or resume it, and open the store.

    The source is a sweep file, the name of a shipped sweep, or what a sweep file would say, as
    data. `set` replaces axes or keys, `only` keeps the runs with these axis values, `limit` the
    first so many, and `drive` says what drives them, as `--drive` does. The store, a folder or an
    address, is `results/NAME` if left out; `fresh` replaces one that is there, `retry_failed` runs
    again what crashed, timed out or failed, and `repair` what is damaged.

    Raises:
        SweepFileError: the sweep or a setting holds mistakes; all are named.
        OutputError: the store cannot be written.
        StoreError: the store is another sweep's.
        StoppedError: the sweep was interrupted; the same call resumes it.
    """
    session = session_in(Path(), **options)
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
        workers=session.workers,
        overrides=Overrides(assigned(set), assigned(only), limit),
        drive=drive_option(drive),
        allow_code=session.allow_code,
    )
    how = {"fresh": fresh, "retry_failed": retry_failed, "repair": repair}
    return session.run(replace(request, **how))


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
    **options: Unpack[RunOptions],
) -> CheckReport:
    """Check a model before it is trusted: six checks with their numbers, and what helps.

    The model is a shipped scene, a folder, an .xml or .urdf file, or `menagerie:ROBOT`. `only`
    names checks, all if empty; `keyframe` is where runs start, `qpos0` being the model's own start;
    the timestep has to suit the `kind` of task; a bare model is driven by an exercise, unless
    `drive` says otherwise. `limits` replace those of the checks, by the name of the measure, and
    findings that are known are accepted. Evidence goes to `results/check/NAME` without `output`.

    Raises:
        SceneError: there is no such model or keyframe, or it does not compile.
        SweepFileError: a setting, or the name of a check or a limit, is wrong.
        PolicyError: what is accepted is not a finding of any check.
    """
    session = session_in(output or RESULTS / "check" / model_name(str(model)), **options)
    start = [f"keyframe={keyframe}"] if keyframe else []
    request = model_check.CheckRequest(
        model=str(model),
        assign=[*assigned(set), *start],
        only=only,
        kind=None if kind == "auto" else kind,
        drive=drive_option(drive),
        limits=limits or {},
        accepted=accept,
        remedies=remedies,
    )
    return model_check.run(request, session)


def effects(
    source: str | Path,
    *,
    set: Settings = (),
    seeds: int = 6,
    error: Literal["reality"] | None = None,
    drive: str | None = None,
    output: str | Path | None = None,
    **options: Unpack[RunOptions],
) -> EffectsReport:
    """Find which effects a scene needs, what each costs, and the smallest set that will do.

    The source is a scene, a sweep file or a model; `set` gives its base configuration, and effects
    are changed with so many seeds; or, if the error is `reality`, on recorded runs. Evidence goes
    to `results/effects/NAME` if `output` is left out.

    Raises:
        SceneError: there is no such scene.
        SweepFileError: the sweep or a setting is wrong.
    """
    session = session_in(output or RESULTS / "effects" / model_name(str(source)), **options)
    driven = drive_option(drive)
    request = EffectsRequest(str(source), assigned(set), seeds, drive=driven, error=error)
    return ablation.run(request, session)


def stability(
    names: Sequence[str | Path] = (),
    *,
    drive: str | None = None,
    output: str | Path = RESULTS / "stability",
    **options: Unpack[RunOptions],
) -> StabilityReport:
    """Run hard cases, or generic checks of models, each into a store in the folder `output`.

    They are named as cases of the catalogue, or as models; the whole catalogue if none is.

    Raises:
        SweepFileError: there is no such case.
    """
    session = session_in(output, **options)
    request = stability_cases.StabilityRequest([str(each) for each in names], drive_option(drive))
    return stability_cases.run(request, session)


def tradeoff(
    source: Store | str | Address,
    *,
    error: str | None = None,
    tolerance: Mapping[str, float] | None = None,
    drive: str | None = None,
    output: str | Address | None = None,
    **options: Unpack[RunOptions],
) -> TradeoffReport:
    """Find what accuracy costs in time, and the cheapest configuration that will do.

    The source is a store; or a sweep file, the name of a shipped sweep, a model file or
    menagerie:ROBOT, which is then run into the store `output`, or `results/tradeoff/NAME`.
    `error` measures accuracy: `error_final`, `oracle_error` or any metric. Tolerances are the
    largest acceptable values by metric, over those of the sweep.

    Raises:
        SweepFileError: the sweep holds mistakes, or a tolerance names what it does not measure.
        StoreError: the store has no error to evaluate.
    """
    session = session_in(RESULTS / "tradeoff", **options)
    request = tradeoff_sweep.TradeoffRequest(
        str(address_of(source)),
        Criteria(error, tolerance or {}),
        None if output is None else parse_address(output),
        drive_option(drive),
    )
    return tradeoff_sweep.run(request, session)


def session_in(
    folder: str | Path,
    *,
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    allow_code: bool = False,
    progress: Progress | None = None,
) -> Session:
    """Return the session of a function, once its plug-ins are loaded."""
    load_plugins([Path(each) for each in plugins])
    done = total = 0

    def begin(runs: int, stored: int) -> None:
        nonlocal done, total
        done, total = stored, runs
        add(())

    def add(finished: Sequence[object]) -> None:
        nonlocal done
        done += len(finished)
        if progress is not None:
            progress(done, total)

    return Session(Path(folder), worker_count(workers), begin, add, allow_code=allow_code)


def assigned(settings: Settings) -> list[str]:
    """Return settings as the command line has them: `NAME=VALUE,VALUE`."""
    if not isinstance(settings, Mapping):
        return list(settings)
    listed = {
        name: value if isinstance(value, list | tuple) else [value]
        for name, value in settings.items()
    }
    return [f"{name}={','.join(map(json.dumps, values))}" for name, values in listed.items()]
