"""The command line. A command imports its modules when it runs, so that --help is instant."""

import errno
import inspect
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from contactlab.command_line.declaration import TITLES, Command, find_command
from contactlab.command_line.front_door import complete_words
from contactlab.command_line.modules import command_modules, commands_of
from contactlab.command_line.parser import adapt_command, explain_mistake
from contactlab.command_line.terminal import echo, notice, say
from contactlab.errors import (
    CommandLineError,
    ContactlabError,
    FaultError,
    OutputError,
    error_text,
    explain_fatal,
    in_one_line,
)
from contactlab.printable import in_one_line as in_one_line_of
from contactlab.printable import printable, shorten_warnings
from contactlab.resources import open_file_limit
from contactlab.temporary_folders import names_temporary_file

_HELP = ("-h", "--help")
_OF_OTHERS = "From other packages"


def command_line(first: str | None = None) -> typer.Typer:
    """Return all commands, or only those that begin with the first word of a line.

    After `--help` they are a list, without parameters.
    """
    app = typer.Typer(
        name="contactlab",
        cls=_GroupedCommands,
        no_args_is_help=True,
        context_settings={"help_option_names": list(_HELP)},
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    app.callback()(contactlab)
    modules = command_modules()
    names = [first] if first in modules else modules
    for name in names:
        _add_command(app, name, commands_of(name), in_list=first in _HELP)
    if first in modules:
        return app
    from contactlab.plugins import find_extensions

    for name, installed in find_extensions("command").items():
        try:
            command = find_command(installed.load())
            app.command(name, epilog=command.end_of_help)(adapt_command(command))
        except Exception as error:  # noqa: BLE001 - an installed package may raise anything
            say(f"warning: there is no command {name}: {in_one_line(error, __file__)}")
    return app


class _GroupedCommands(TyperGroup):
    """All commands, listed by groups in the help."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 - of Click's
        """Write a section for each group, and one for commands of other packages."""
        del ctx
        rows_by_title: dict[str, list[tuple[str, str]]] = {title: [] for title in TITLES.values()}
        summary_width = 66  # columns that a line of 80 leaves for the summary of a command
        for name, group_command in self.commands.items():
            title = TITLES[commands_of(name)[0].group] if name in command_modules() else _OF_OTHERS
            rows_by_title.setdefault(title, []).append(
                (name, group_command.get_short_help_str(summary_width))
            )
        for title, rows in rows_by_title.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


def _add_command(
    app: typer.Typer, name: str, commands: Sequence[Command], *, in_list: bool
) -> None:
    """Add a command, or a group of commands that share their first word."""
    if [command.name for command in commands] == [name]:
        app.command(name, epilog=commands[0].end_of_help)(
            adapt_command(commands[0], in_list=in_list)
        )
        return
    doc = inspect.getdoc(inspect.getmodule(commands[0].function)) or ""
    group = typer.Typer(help=doc.partition("\n")[0], no_args_is_help=True)
    for command in commands:
        inner = command.name.removeprefix(name).strip()
        if inner:
            group.command(inner, epilog=command.end_of_help)(
                adapt_command(command, in_list=in_list)
            )
        else:
            group.callback(
                invoke_without_command=True, no_args_is_help=False, epilog=command.end_of_help
            )(adapt_command(command, in_list=in_list, of_group=True))
    app.add_typer(group, name=name)


def _print_version(is_wanted: bool) -> None:
    if is_wanted:
        from importlib.metadata import version

        echo(f"contactlab {version('contactlab')}")
        raise typer.Exit


def contactlab(
    *,
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print version."
    ),
    allow_files: list[Path] | None = typer.Option(
        None,
        metavar="DIR",
        help="Let models use files of this folder, outside their own; may be repeated.",
    ),
) -> None:
    """Evidence for contact simulation: `contactlab MODEL` judges a model.

    A model is an .xml or .urdf file, a shipped scene, or menagerie:ROBOT.
    """
    del version
    if allow_files:
        from contactlab.scene.model_guards import allow_files as allow

        allow(allow_files)


def _run_words(words: Sequence[str]) -> int:
    app = command_line(words[0] if words else _HELP[0])
    try:
        code = app(words, prog_name="contactlab", standalone_mode=False)
    except typer.TyperException as error:
        if (message := error.format_message()).startswith("Usage:"):  # no words: its whole help
            say(message)
            return CommandLineError.exit_code
        raise explain_mistake(error, words) from error
    return code if isinstance(code, int) else 0


def _check_surroundings(words: Sequence[str]) -> None:
    if sys.flags.optimize > 1:
        raise CommandLineError(
            "without docstrings (python -OO) libraries of contactlab fail; set PYTHONOPTIMIZE=1"
        )
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise CommandLineError("the current folder was removed; change to another one") from error
    for word in words:
        # Such bytes of a name of a file become lone surrogates, which no library takes as text.
        if not word.isascii() and word.encode("utf-8", "replace").decode() != word:
            raise CommandLineError(f"{printable(word)} is not UTF-8 text; rename the file")
    # Workers take pipes and sockets besides the files of a store; half of this is too few.
    open_files, least = open_file_limit(), 40
    if open_files < least:
        raise CommandLineError(
            f"a process may open {open_files} files here; raise the limit (ulimit -n {least})"
        )


def main() -> None:
    """Run the command line; an error that the user can act on is printed as one message."""
    # Processes that this one starts, or its libraries, import nothing of the current folder.
    os.environ["PYTHONSAFEPATH"] = "1"
    shorten_warnings(names_temporary_file)
    try:
        _check_surroundings(sys.argv[1:])
        sys.exit(_run_words(complete_words(sys.argv[1:])))
    except ContactlabError as error:
        if text := str(error):
            say(text if text.startswith("error") else f"error: {text}")
        raise SystemExit(error.exit_code) from error
    except OSError as error:
        where, why = error.filename, error.strerror or str(error)
        if where is None and error.errno == errno.ENOSPC:
            # The rest of the buffer cannot be printed either.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            where = "cannot print the results"
        say(f"error: {in_one_line_of(str(where or 'the system refuses'))}: {why}")
        raise SystemExit(OutputError.exit_code) from error
    except Exception as error:
        if isinstance(error, MemoryError) or "Could not allocate memory" in str(error):
            say("error: out of memory; free some, or raise its limit (ulimit -v)")
            raise SystemExit(OutputError.exit_code) from error
        if str(error).startswith("Symlink loop"):  # of `Path.resolve`
            say(f"error: {in_one_line_of(str(error))}; name a file")
            raise SystemExit(CommandLineError.exit_code) from error
        if "MUJOCO_GL" in str(error):
            say(f"error: {in_one_line_of(str(error))}; unset it, or set it to egl, osmesa or glfw")
            raise SystemExit(CommandLineError.exit_code) from error
        if type(error).__qualname__ == "FatalError" and type(error).__module__ == "mujoco":
            # The class is not imported, because most commands need no MuJoCo.
            why = in_one_line_of(explain_fatal(error))
            say(f"error: MuJoCo cannot simulate the model: {why}")
            raise SystemExit(CommandLineError.exit_code) from error
        if os.environ.get("CONTACTLAB_TRACEBACK"):
            raise
        *_, last = traceback.extract_tb(error.__traceback__)
        say(
            f"error: a fault of contactlab: {error_text(error)}, at line {last.lineno} of "
            f"{Path(last.filename).name}; please report it with "
            "the output under CONTACTLAB_TRACEBACK=1"
        )
        raise SystemExit(FaultError.exit_code) from error
    finally:
        notice.clear()
