"""The command line. Each command imports its room when it runs, so that --help is instant."""

import os
import sys

import typer
from rich.console import Console

from contactlab.commands.init import init
from contactlab.commands.replay import replay
from contactlab.commands.scenes import scenes
from contactlab.commands.schema import schema
from contactlab.commands.show import show
from contactlab.commands.sweep import sweep
from contactlab.commands.sweeps import sweeps
from contactlab.commands.verify import verify
from contactlab.errors import ContactlabError

INTERRUPTED = 130

app = typer.Typer(
    name="contactlab",
    help="Evidence for contact simulation: sweeps of MuJoCo rollouts, labelled and stored.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
for command in (sweep, show, replay, verify, scenes, sweeps, init, schema):
    app.command()(command)


def main() -> None:
    """Run the command line; failures that a user can act on end in one clear message."""
    try:
        app()
    except ContactlabError as error:
        _say(f"error: {error}" if not str(error).startswith("error") else str(error))
        raise SystemExit(error.exit_code) from error
    except KeyboardInterrupt as error:
        _say("interrupted; the same command goes on where it stopped")
        raise SystemExit(INTERRUPTED) from error
    except BrokenPipeError:
        # The reader of our output left; Python would complain once more while it shuts down.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(0) from None


def _say(message: str) -> None:
    Console(stderr=True).print(message, markup=False, highlight=False, soft_wrap=True)
