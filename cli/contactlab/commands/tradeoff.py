"""`contactlab tradeoff`: the time that accuracy costs in a sweep, and the recommendation."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Unpack

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Option, command
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say, study_session
from contactlab.errors import OutputError, SweepFileError
from contactlab.printable import shell_word
from contactlab.resources import RESULTS

if TYPE_CHECKING:
    from contactlab.schema.tradeoff_report import TradeoffReport
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import Address


@command(
    "examine",
    keeps="finished runs",
    examples=("tradeoff results/bounce --tolerance oracle_error=1%",),
    formats=report_formats(),
)
def tradeoff(
    source: Annotated[
        "Store | Address | str",
        Argument("STORE|SWEEP", "Store, or sweep to run.", kind=str),
    ],
    *,
    metric: opt.ErrorMetric = None,
    figure: opt.Figure = None,
    write: Annotated[
        str | Path | None,
        Option("FILE", "Write a sweep file of the recommended settings.", kind=Path),
    ] = None,
    model: Annotated[
        str | Path | None,
        Option("FOLDER", "Write the model with these settings, and a patch.", kind=Path),
    ] = None,
    output: opt.StoreOutput = None,
    workers: opt.Workers = None,
    plugin: opt.Plugins = (),
    allow_code: opt.AllowCode = False,
    **task: Unpack[opt.TaskParameters],
) -> "TradeoffReport":
    """Weigh accuracy against time in a sweep; recommend a configuration.

    `output` is the store of a sweep, `results/tradeoff/NAME` by default. `tolerance` replaces
    tolerances of the sweep by metric. For a model, use `tune`.

    Raises:
        SweepFileError: the sweep has mistakes, a tolerance names an unknown column, or the source
            is a model.
        StoreError: the store has no error to evaluate.
        OutputError: a file cannot be written.
    """
    from contactlab.pareto.analysis import analyze_tradeoff
    from contactlab.pareto.criteria import Criteria, find_store
    from contactlab.scene.scene_source import MODEL_SUFFIXES, is_menagerie
    from contactlab.store.finished_store import Store

    opt.load_plugins(plugin)
    task_options = opt.task_of(**task)
    if is_menagerie(str(source)) or Path(str(source)).suffix in MODEL_SUFFIXES:
        raise SweepFileError(
            f"{source} is a model, not a sweep or a store. Write contactlab tune "
            f"{shell_word(str(source))}"
        )
    criteria = Criteria(metric, task_options.limits)
    sweep_file, folder = (None if path is None else Path(path) for path in (write, model))
    # Files that cannot be written are refused before anything is run.
    opt.check_figure(figure)
    if sweep_file is not None and not sweep_file.parent.is_dir():
        raise OutputError(
            f"cannot write {sweep_file}: no folder {sweep_file.parent}; create it first"
        )
    if sweep_file is not None and sweep_file.exists():
        raise OutputError(f"{sweep_file} exists; choose another file with --write")
    if (
        folder is not None
        and folder.exists()
        and not (folder.is_dir() and not any(folder.iterdir()))
    ):
        raise OutputError(f"{folder} is not an empty folder; choose another one with --model")
    name = str(opt.address_of(source))
    target = None if output is None else opt.address_of(output)
    opened = None
    if (address := find_store(name, target)) is not None:
        opened = Store.open(address)
        exist = "exist already; write --tolerance METRIC=VALUE, such as slip=1mm"
        opt.refuse_parts(task_options, ["tolerance"], f"the runs of a store {exist}")
        parts = ["keyframe", "drive", "duration", "observe", "require", "seeds"]
        opt.refuse_parts(
            task_options, parts, f"the runs of {name} exist already; give their sweep instead"
        )
        opt.mention_damage(opened)
    if opened is not None and model is None:
        report = analyze_tradeoff(opened, criteria)
    else:
        # An engine is needed to run a sweep, and to write a model.
        from contactlab.measure import METRICS
        from contactlab.schema.evidence import ERRORS
        from contactlab.studies.tradeoff_sweep import TradeoffRequest, sweep_settings

        rest = "; `contactlab list metrics` lists all"
        if metric is not None:
            metric_names = [*METRICS, *ERRORS]
            SweepFileError.unless_known(
                metric, metric_names, f"--metric {metric}: no such metric", rest
            )
        request = TradeoffRequest(name, criteria, target, task_options, folder)
        with study_session(RESULTS / "tradeoff", workers, allow_code=allow_code) as session:
            report = sweep_settings(request, session)
    if figure is not None:
        from contactlab.charts import save_figure
        from contactlab.pareto.tradeoff_chart import chart_specification

        save_figure(chart_specification(report), Path(figure))
        say(f"drew {figure}")
    if sweep_file is not None and report.recommendation is not None:
        _write_sweep(sweep_file, report)
    return report


def _write_sweep(path: Path, report: "TradeoffReport") -> None:
    from contactlab.pareto.configuration_export import recommended_sweep
    from contactlab.schema.evidence import ERRORS
    from contactlab.store.atomic_files import atomic_write
    from contactlab.store.finished_store import Store
    from contactlab.store.store_files import parse_address

    store = Store.open(parse_address(report.store))
    text = recommended_sweep(store, report, path.parent)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    command = "tradeoff" if report.tolerances.keys() & set(ERRORS) else "sweep"
    say(f"wrote {path}\nnext: contactlab {command} {shell_word(path)}")
