"""The command line. A command imports what it needs when it runs, so that --help is instant."""

import errno
import os
import sys
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

from contactlab.commands.options import end_of_help, option
from contactlab.commands.terminal import echo, notice, say
from contactlab.errors import ContactlabError, OutputError, in_one_line
from contactlab.printable import printable

# Where each command is, in the order of --help.
_RUN = {
    "sweep": "sweep_command",
    "stability": "study_commands",
    "effects": "study_commands",
    "check": "study_commands",
    "tradeoff": "tradeoff_command",
}
_READ = {
    "show": "store_commands",
    "replay": "store_commands",
    "render": "drawing_commands",
    "verify": "store_commands",
    "compare": "compare_command",
    "report": "drawing_commands",
}
_LISTS = ("scenes", "sweeps", "metrics", "labels", "thresholds", "init", "schema")
_LIST = dict.fromkeys(_LISTS, "list_commands")
_GROUPS = {
    "baseline": ("compare_command", "baselines"),
    "engines": ("list_commands", "engines"),
    "traces": ("trace_commands", "traces"),
}
_EXAMPLES = {
    "sweep": ("sweep grasp", "sweep grid.yaml --set timestep=1e-3 --workers 4"),
    "stability": ("stability", "stability robot.xml --duration 5"),
    "effects": ("effects grasp_mug",),
    "check": ("check robot.xml", "check menagerie:franka_emika_panda --format junit"),
    "tradeoff": ("tradeoff results/bounce --tolerance oracle_error=1%",),
    "show": (
        "show results/grasp",
        "show results/grasp 3ead3115",
        "show results/grasp --format csv",
    ),
    "replay": ("replay results/grasp 3ead3115", "replay results/grasp 3ead3115 --view"),
    "render": ("render results/grasp 3ead3115 -o run.mcap",),
    "verify": ("verify results/grasp --simulate 20",),
    "compare": ("compare results/before results/after",),
    "report": ("report results/grasp", "report results/grasp --figures paper --format pdf"),
    "scenes": ("scenes", "scenes grasp_mug"),
    "init": ("init robot.xml -o robot.yaml",),
    "schema": ("schema --write schemas",),
}
_EXIT_CODES = (
    (_RUN, "0 as expected, 1 not, 2 bad input, 3 bad store, 4 runs lost, 130 interrupted"),
    (_READ, "0 sound or equal, 1 it differs, 2 bad input, 3 bad or damaged store"),
    (_LIST, "0 printed, 2 bad input"),
)


def command_line(first: str | None = None) -> typer.Typer:
    """Return all commands, or no more than the one that a command line begins with."""
    app = typer.Typer(
        name="contactlab",
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(contactlab)
    known = first in {**_RUN, **_READ, **_LIST, **_GROUPS}
    for places, codes in _EXIT_CODES:
        for name, module in places.items():
            if first == name or not known:
                end = end_of_help(_EXAMPLES.get(name, (name,)), codes)
                app.command(epilog=end)(_loaded(module, name))
    for name, place in _GROUPS.items():
        if first == name or not known:
            app.add_typer(_loaded(*place), name=name)
    if not known:
        _add_installed(app)
    return app


def _loaded(module: str, name: str) -> Any:  # noqa: ANN401 - a command, or a group of them
    return getattr(import_module(f"contactlab.commands.{module}"), name)


def _add_installed(app: typer.Typer) -> None:
    from contactlab.plugins import extensions

    for name, installed in extensions("command").items():
        try:
            command = installed.load()
            app.command(name, epilog=getattr(command, "end_of_help", None))(command)
        except Exception as error:  # noqa: BLE001 - an installed package may raise anything
            say(f"warning: there is no command {name}: {in_one_line(error, __file__)}")


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        echo(f"contactlab {version('contactlab')}")
        raise typer.Exit


def contactlab(
    *,
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print version."
    ),
    allow_files: list[Path] | None = option(
        "DIR", "Let models name the files of a folder outside of their own; may be repeated."
    ),
) -> None:
    """Evidence for contact simulation: sweeps of MuJoCo rollouts, labelled and stored."""
    del version
    if allow_files:
        from contactlab.scene.model_guards import allow_files as allow

        allow(allow_files)


def main() -> None:
    """Run the command line; an error that the user can act on is printed as one message."""
    # What this starts, and what its libraries start, imports nothing of the current folder.
    os.environ["PYTHONSAFEPATH"] = "1"
    warnings.formatwarning = lambda message, *_: f"warning: {printable(str(message))}\n"
    try:
        if sys.argv[1:] and sys.argv[1] not in {"show", *_LIST} and sys.argv[1][:1] != "-":
            notice.show()
        command_line(*sys.argv[1:2])(prog_name="contactlab")
    except ContactlabError as error:
        say(f"error: {error}" if not str(error).startswith("error") else str(error))
        raise SystemExit(error.exit_code) from error
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        # What is left in the buffer cannot be printed either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        say(f"error: cannot print the results: {error.strerror}")
        raise SystemExit(OutputError.exit_code) from error
    finally:
        notice.clear()
