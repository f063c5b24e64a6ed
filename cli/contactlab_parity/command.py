"""`contactlab parity`: whether an engine does what MuJoCo does, before anything is scaled."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import (
    echo,
    echo_commands,
    progress_display,
    resumable,
    say,
)
from contactlab.errors import (
    EngineError,
    ExpectationError,
    StoppedError,
    StoreError,
    SweepFileError,
)

if TYPE_CHECKING:
    from contactlab.engines.engine import SimulationEngine
    from contactlab.plan.overrides import Overrides
    from contactlab.schema.comparison import ComparePolicy
    from contactlab_parity.panel import Panel
    from contactlab_parity.parity_report import ParityReport, RunParity
    from contactlab_parity.sweep_parity import ParityRequest

ParityFormat = Literal["text", "json", "markdown", "junit", "github"]


@opt.helped(
    "parity grasp --against warp",
    "parity grid.yaml --bundle bundle",
    "parity --from bundle",
    codes="0 it does what MuJoCo does, 1 not, 2 bad input, 3 it cannot be judged, 130 interrupted",
)
def parity(
    name: str | None = typer.Argument(None, metavar="SWEEP", help="Sweep file or shipped sweep."),
    against: str | None = opt.option("ENGINE", "Engine to compare with MuJoCo."),
    bundle: Path | None = opt.option(
        "FOLDER", "Write the runs there, for Newton on another machine, instead of comparing."
    ),
    judged: Path | None = typer.Option(
        None, "--from", metavar="FOLDER", help="Judge the results of a bundle's script there."
    ),
    assign: list[str] | None = opt.SET,
    only: list[str] | None = opt.option(
        "NAME=VALUE", "Keep runs with a value: cone=elliptic; may be repeated."
    ),
    limit: int | None = opt.option("N", "Keep the first N runs.", min=1),
    changes: list[str] | None = typer.Option(
        None, "--with", metavar="NAME=VALUE", help="Set this for the engine alone; may be repeated."
    ),
    device: str = opt.option("cpu|cuda", "What the engine computes on; by default its own.", ""),
    drive: str | None = opt.DRIVE,
    policy: Path | None = opt.option("FILE", "Policy file: what the engine may differ by."),
    plugin: list[Path] | None = opt.PLUGIN,
    output: ParityFormat = opt.FORMAT,
) -> None:
    """Compare an engine with MuJoCo, stage by stage; exit with 1 if it differs."""
    from contactlab.plan.overrides import Overrides
    from contactlab.run.tasks import Finished
    from contactlab_parity.sweep_parity import ParityRequest, run

    opt.load_plugins(plugin)
    if len([each for each in (against, bundle, judged) if each]) != 1 or bool(name) == bool(judged):
        raise SweepFileError(
            "give SWEEP with --against ENGINE or with --bundle FOLDER, or --from FOLDER alone"
        )
    overrides, changed = Overrides(assign or (), only or (), limit), tuple(changes or ())
    if bundle:
        _write_bundle(str(name), overrides, drive, bundle)
        return
    if judged:
        request = _bundled(judged, policy)
    else:
        engine = _engine(str(against), device)
        panel = _panel(str(name), engine.name, overrides, changed, drive)
        request = ParityRequest(panel, engine, device, changed, _policy(policy))
    with resumable("start over") as stop, progress_display() as display:

        def done(run: "RunParity") -> None:
            display.advance([Finished(b"", run.verdict, run.verdict, None)])
            if stop.is_set:
                raise StoppedError("stopped")

        report = run(request, lambda total: display.begin(total, 0), done)
    show = echo_commands if output == "github" else echo
    show(_rendered(report, output).removesuffix("\n"))
    if report.exit_code == ExpectationError.exit_code:
        raise ExpectationError(report.headline)
    if report.exit_code:
        raise StoreError(report.headline)


def _panel(
    name: str, engine: str, overrides: "Overrides", changes: Sequence[str], drive: str | None
) -> "Panel":
    from contactlab import resources
    from contactlab.plan.overrides import drive_option
    from contactlab_parity.panel import Panel

    return Panel.read(resources.find_sweep(name), engine, overrides, changes, drive_option(drive))


def _write_bundle(name: str, overrides: "Overrides", drive: str | None, folder: Path) -> None:
    from contactlab.comparison.checks import plural
    from contactlab_parity.bundle import ENGINE, write_bundle

    panel = _panel(name, ENGINE, overrides, (), drive)
    made = write_bundle(panel, overrides, drive, folder)
    echo(f"{plural(len(made.runs), 'run')} in {folder}, for its check_newton.py")
    for why in dict.fromkeys(made.refused.values()):
        say(f"{plural(list(made.refused.values()).count(why), 'run')} left out: {why}")


def _bundled(folder: Path, policy: Path | None) -> "ParityRequest":
    from contactlab_parity.bundle import Bundle
    from contactlab_parity.bundled_engine import BundledEngine
    from contactlab_parity.sweep_parity import ParityRequest

    bundle = Bundle.read(folder)
    engine = BundledEngine(folder, bundle)
    return ParityRequest(bundle.panel(folder), engine, engine.device, (), _policy(policy))


def _engine(name: str, device: str) -> "SimulationEngine":
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine

    engine = find_engine(name)
    if isinstance(engine, AdaptedEngine) and engine.absence:
        raise EngineError(engine.absence)
    if not device:
        return engine
    if not isinstance(engine, AdaptedEngine):
        raise EngineError(f"--device {device}: the {name} engine computes where this runs")
    return engine.on(device)


def _policy(path: Path | None) -> "ComparePolicy":
    from contactlab.plan.sweep_file import read_yaml_as
    from contactlab.schema.comparison import ComparePolicy

    return ComparePolicy(version=1) if path is None else read_yaml_as(path, ComparePolicy)


def _rendered(report: "ParityReport", output: ParityFormat) -> str:
    from contactlab_parity.formats import as_annotations, as_junit, as_markdown, as_text

    match output:
        case "text":
            return as_text(report)
        case "json":
            return report.model_dump_json(indent=2)
        case "markdown":
            return as_markdown(report)
        case "junit":
            return as_junit(report)
        case "github":
            return as_annotations(report)
