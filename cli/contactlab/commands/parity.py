"""`contactlab parity`: whether another engine agrees with MuJoCo."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Arguments, Option, command, flag
from contactlab.command_line.judgements import find_failure, list_printers, policy_of
from contactlab.command_line.report_formats import formats_by_type, report_formats
from contactlab.command_line.surroundings import say, study_session, surroundings
from contactlab.command_line.terminal import echo
from contactlab.errors import (
    ContactlabError,
    EngineError,
    StoppedError,
    SweepFileError,
)

if TYPE_CHECKING:
    from contactlab.engines.engine import SimulationEngine
    from contactlab.plan.overrides import Overrides
    from contactlab.schema.engine_panel import EnginePanel
    from contactlab.schema.store_reports import WrittenBundle
    from contactlab.studies.parity.panel import Panel
    from contactlab.studies.parity.parity_report import ParityReport, RunParity
    from contactlab.studies.parity.sweep_parity import ParityRequest
    from contactlab.writers import Report


def _report_of(report: "ParityReport", arguments: Arguments) -> "Report":
    from contactlab.studies.parity.report_sections import report_of

    del arguments
    return report_of(report)


def _find_failure(
    result: "ParityReport | WrittenBundle | EnginePanel | str", arguments: Arguments
) -> ContactlabError | None:
    from contactlab.studies.parity.parity_report import ParityReport

    return find_failure(result, arguments) if isinstance(result, ParityReport) else None


def _print_installed(version: str, arguments: Arguments) -> None:
    echo(f"{arguments['install']} {version}")


def _panel_folder(output: str | Path | None) -> Path:
    from contactlab.resources import RESULTS

    return RESULTS / "engines" if output is None else opt.folder_of(output)


@command(
    "gate",
    keeps=lambda given: "nothing" if given["from_"] else "finished runs",
    examples=(
        "parity grasp --against warp",
        "parity grid.yaml --bundle bundle",
        "parity --from bundle",
        "parity bounce stack --closed-forms --against mujoco,drake",
        "parity --install bullet",
    ),
    codes="0 it agrees with MuJoCo, 1 not, 2 bad input, 3 it cannot be judged, 130 interrupted",
    formats=formats_by_type(
        {
            "ParityReport": list_printers(_report_of),
            "WrittenBundle": report_formats(),
            "EnginePanel": report_formats(lambda given: _panel_folder(given["output"])),
            "str": {"text": _print_installed},
        }
    ),
    failure=_find_failure,
)
def parity(
    sources: Annotated[
        str | Path | Sequence[str | Path],
        Argument(
            "SWEEP|TASK",
            "Sweep file or shipped sweep; with --closed-forms tasks, all by default.",
            kind=list[str],
        ),
    ] = (),
    *,
    against: Annotated[
        str | None,
        Option("ENGINE", "Engine to compare with MuJoCo; with --closed-forms several: A,B."),
    ] = None,
    closed_forms: Annotated[
        bool, flag("Compare engines with closed forms, at three steps each, and their CPU time.")
    ] = False,
    install: Annotated[
        str | None,
        Option("ENGINE", "Only install an engine, in an environment of its own."),
    ] = None,
    bundle: Annotated[
        str | Path | None,
        Option(
            "FOLDER",
            "Write the runs to a folder, for Newton on another machine.",
            kind=Path,
        ),
    ] = None,
    from_: Annotated[
        str | Path | None,
        Option("FOLDER", "Judge the results of a bundle in a folder.", kind=Path),
    ] = None,
    set: opt.Set = (),
    where: opt.Where = (),
    limit: opt.Limit = None,
    with_: Annotated[
        opt.Settings,
        Option("NAME=VALUE", "Setting of the engine only; may be repeated.", kind=list[str]),
    ] = (),
    device: Annotated[str, Option("cpu|cuda", "Device of the engine; default: its own.")] = "",
    drive: opt.Drive = None,
    policy: Annotated[
        str | Path | None,
        Option("FILE", "Policy file: tolerances of the differences.", kind=Path),
    ] = None,
    figure: opt.Figure = None,
    output: opt.StudyFolder = None,
    plugin: opt.Plugins = (),
) -> "ParityReport | WrittenBundle | EnginePanel | str":
    """Compare an engine with MuJoCo, or engines with closed forms.

    Give a sweep with `against` or with `bundle`, or `from_` alone. Finished runs are stored in
    `results/parity/NAME` unless `output` is given, and are not repeated. With `closed_forms`, each
    task and engine has a store in `results/engines`. With `install` the result is the installed
    version.

    Raises:
        SweepFileError: the sweep or a setting holds mistakes.
        EngineError: there is no such engine, or it is not installed.
    """
    from contactlab.plan.overrides import Overrides
    from contactlab.studies.parity.sweep_parity import ParityRequest

    opt.load_plugins(plugin)
    source_names = [
        str(each) for each in ([sources] if isinstance(sources, str | Path) else sources)
    ]
    if install is not None:
        return _install_engine(install)
    if closed_forms:
        return _compare_engines(source_names, (against or "").split(","), figure, output)
    if figure is not None:
        raise SweepFileError("--figure draws the comparison of --closed-forms; add it")
    source = source_names[0] if source_names else None
    actions = [each for each in (against, bundle, from_) if each]
    if len(actions) != 1 or bool(source) == bool(from_) or len(source_names) > 1:
        raise SweepFileError(
            "give SWEEP with --against ENGINE or with --bundle FOLDER, or --from FOLDER alone"
        )
    overrides = Overrides(opt.write_assignments(set), opt.write_assignments(where), limit)
    if bundle:
        return _write_bundle(str(source), overrides, drive, Path(bundle))
    if from_:
        from contactlab.studies.parity.bundle import Bundle
        from contactlab.studies.parity.bundled_engine import BundledEngine

        read_bundle = Bundle.read(Path(from_))
        bundled_engine = BundledEngine(Path(from_), read_bundle)
        rules = policy_of(policy)
        return _compare_runs(
            ParityRequest(
                read_bundle.panel(Path(from_)), bundled_engine, bundled_engine.device, (), rules
            )
        )
    engine, changed = _open_engine(str(against), device), tuple(opt.write_assignments(with_))
    panel = _make_panel(str(source), engine.name, overrides, changed, drive)
    folder = opt.study_folder("parity", source, output)
    return _compare_runs(ParityRequest(panel, engine, device, changed, policy_of(policy), folder))


def _install_engine(name: str) -> str:
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine
    from contactlab.run.mujoco_environment import make_environment

    engine = find_engine(name)
    if not isinstance(engine, AdaptedEngine) or engine.version:
        return f"{engine.version} is already installed"
    say(f"setting up {name} in {engine.environment}, once")
    advice = f"check whether this machine can run {' and '.join(engine.requirements)}"
    make_environment(engine.environment, engine.requirements, name, advice, lambda _: None)
    return engine.version


def _compare_engines(
    tasks: Sequence[str],
    engines: Sequence[str],
    figure: str | Path | None,
    output: str | Path | None,
) -> "EnginePanel":
    from contactlab.studies.engine_panel.engine_panel import PanelRequest, run_panel

    opt.check_figure(figure)
    with study_session(_panel_folder(output), 0) as session:
        report = run_panel(PanelRequest(list(tasks), [*filter(None, engines)]), session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.studies.engine_panel.panel_chart import chart_panel

        save_figure(chart_panel(report), Path(figure))
        say(f"drew {figure}")
    return report


def _compare_runs(request: "ParityRequest") -> "ParityReport":
    from contactlab.run.tasks import FinishedRun
    from contactlab.studies.parity.sweep_parity import compare_runs

    with surroundings().watching() as watch:

        def advance_watch(compared: "RunParity") -> None:
            watch.advance([FinishedRun(b"", compared.verdict, compared.verdict, None)])
            if watch.stop is not None and watch.stop.is_set:
                raise StoppedError("stopped")

        return compare_runs(request, watch.begin, advance_watch)


def _make_panel(
    name: str, engine: str, overrides: "Overrides", changes: Sequence[str], drive: str | None
) -> "Panel":
    from contactlab import resources
    from contactlab.plan.overrides import drive_option
    from contactlab.studies.parity.panel import Panel

    return Panel.read(resources.find_sweep(name), engine, overrides, changes, drive_option(drive))


def _write_bundle(
    name: str, overrides: "Overrides", drive: str | None, folder: Path
) -> "WrittenBundle":
    from contactlab.judge.wording import plural
    from contactlab.schema.store_reports import WrittenBundle
    from contactlab.studies.parity.bundle import ENGINE, write_bundle

    panel = _make_panel(name, ENGINE, overrides, (), drive)
    new_bundle = write_bundle(panel, overrides, drive, folder)
    for why in dict.fromkeys(new_bundle.refused.values()):
        say(f"{plural(list(new_bundle.refused.values()).count(why), 'run')} refused: {why}")
    return WrittenBundle(folder=folder, runs=len(new_bundle.runs), refused=dict(new_bundle.refused))


def _open_engine(name: str, device: str) -> "SimulationEngine":
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine

    engine = find_engine(name)
    if isinstance(engine, AdaptedEngine) and engine.absence:
        raise EngineError(engine.absence)
    if not device:
        return engine
    if not isinstance(engine, AdaptedEngine):
        raise EngineError(f"--device {device}: the {name} engine runs on this machine only")
    return engine.on(device)
