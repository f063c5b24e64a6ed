"""`contactlab parity`: whether an engine does what MuJoCo does, before anything is scaled."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, progress_display, resumable
from contactlab.errors import EngineError, ExpectationError, StoppedError, StoreError

if TYPE_CHECKING:
    from contactlab.engines.engine import SimulationEngine
    from contactlab.schema.comparison import ComparePolicy
    from contactlab_parity.parity_report import ParityReport, RunParity

ParityFormat = Literal["text", "json", "markdown", "junit"]


def parity(
    name: str = typer.Argument(..., metavar="SWEEP", help="Sweep file or shipped sweep."),
    against: str = opt.option("ENGINE", "Engine to compare with MuJoCo.", ...),
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
    from contactlab import resources
    from contactlab.plan.overrides import Overrides, drive_option
    from contactlab.run.tasks import Finished
    from contactlab_parity.panel import Panel
    from contactlab_parity.sweep_parity import ParityRequest, run

    opt.load_plugins(plugin)
    engine, changed = _engine(against, device), tuple(changes or ())
    path = resources.find_sweep(name)
    overrides = Overrides(assign or (), only or (), limit)
    panel = Panel.read(path, engine.name, overrides, changed, drive_option(drive))
    request = ParityRequest(panel, engine, device, changed, _policy(policy))
    with resumable("start over") as stop, progress_display() as display:

        def done(run: "RunParity") -> None:
            display.advance([Finished(b"", run.verdict, run.verdict, None)])
            if stop.is_set:
                raise StoppedError("stopped")

        report = run(request, lambda total: display.begin(total, 0), done)
    echo(_rendered(report, output).removesuffix("\n"))
    if report.exit_code == ExpectationError.exit_code:
        raise ExpectationError(report.headline)
    if report.exit_code:
        raise StoreError(report.headline)


def _engine(name: str, device: str) -> "SimulationEngine":
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine

    engine = find_engine(name)
    if not engine.version:
        raise EngineError(
            f"the {name} engine is not installed; do so once with `contactlab engines add {name}`"
        )
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
    from contactlab_parity.formats import as_junit, as_markdown, as_text

    match output:
        case "text":
            return as_text(report)
        case "json":
            return report.model_dump_json(indent=2)
        case "markdown":
            return as_markdown(report)
        case "junit":
            return as_junit(report)
