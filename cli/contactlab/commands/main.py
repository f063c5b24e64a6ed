"""The command line. Each command imports its room when it runs, so that --help is instant."""

import typer
from rich.console import Console

from contactlab.commands.baseline_command import app as baseline
from contactlab.commands.check_command import check
from contactlab.commands.compare_command import compare
from contactlab.commands.effects_command import effects
from contactlab.commands.init_command import init
from contactlab.commands.list_commands import labels, metrics, scenes, sweeps, thresholds
from contactlab.commands.render_command import render
from contactlab.commands.replay_command import replay
from contactlab.commands.report_command import report
from contactlab.commands.schema_command import schema
from contactlab.commands.show_command import show
from contactlab.commands.stability_command import stability
from contactlab.commands.sweep_command import sweep
from contactlab.commands.tradeoff_command import tradeoff
from contactlab.commands.verify_command import verify
from contactlab.errors import ContactlabError

app = typer.Typer(
    name="contactlab",
    help="Evidence for contact simulation: sweeps of MuJoCo rollouts, labelled and stored.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (
    sweep,
    stability,
    effects,
    check,
    tradeoff,
    show,
    replay,
    render,
    verify,
    compare,
    report,
    scenes,
    sweeps,
    metrics,
    labels,
    thresholds,
    init,
    schema,
):
    app.command()(command)
app.add_typer(baseline, name="baseline")


def main() -> None:
    """Run the command line; failures that a user can act on end in one clear message."""
    try:
        app(prog_name="contactlab")
    except ContactlabError as error:
        _say(f"error: {error}" if not str(error).startswith("error") else str(error))
        raise SystemExit(error.exit_code) from error


def _say(message: str) -> None:
    Console(stderr=True).print(message, markup=False, highlight=False, soft_wrap=True)
