"""Command lines that files show, parsed by the real parser and run up to their first step.

Before its first step, a command refuses names that do not exist: of options, sweeps, scenes,
checks, metrics, engines. A file that a line names and the project does not have, as `robot.xml`, is
written for it. Names in such a model are not the project's, and may be missing.
"""

import contextlib
import difflib
import inspect
import io
import os
import re
import shlex
import shutil
import subprocess
import urllib.request
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mujoco
import typer
import typer.main
from tests.docs.shown_commands import HOLE, ShownCommand

import contactlab
from contactlab.budget import windows
from contactlab.command_line.declaration import Argument, Option, Parameter
from contactlab.command_line.front_door import complete_words
from contactlab.command_line.main import command_line
from contactlab.command_line.modules import command_modules, commands_of
from contactlab.command_line.parser import described_type
from contactlab.engines import ENGINES, mujoco_batch
from contactlab.errors import (
    ClusterError,
    CommandLineError,
    ContactlabError,
    EngineError,
    OutputError,
    StoreError,
    SweepFileError,
)
from contactlab.run.ray import connection
from contactlab.run.worker_pool import LocalPool

ROOT = Path(__file__).parents[2]
MODEL = """
<mujoco>
  <option timestep="0.004"/>
  <worldbody>
    <geom name="standin_floor" type="plane" size="1 1 .1"/>
    <body name="standin_body" pos="0 0 .0499">
      <joint name="standin_x" type="slide" axis="1 0 0" range="-.5 .5" damping="1"/>
      <joint name="standin_z" type="slide" axis="0 0 1"/>
      <geom name="standin_foot" type="sphere" size=".05" mass=".2"/>
    </body>
  </worldbody>
  <actuator><position name="standin_motor" joint="standin_x" kp="20" ctrlrange="-.2 .2"/></actuator>
  <keyframe><key name="standin_key" qpos="0 0"/></keyframe>
</mujoco>
"""
SWEEP = """
version: 1
scene: standin.xml
drive: none
duration: 0.02
axes: {timestep: [2.0e-3, 4.0e-3]}
"""
_STAND_IN = "standin"
# What a word in capitals, or with a variable of the shell, stands for is not known.
_PLACEHOLDER = re.compile(r"[A-Z][A-Z_]*|.*(\$|\{\}|<\w+>|\{\w+\}).*")
_LEFT_OUT = "..."
_MISSING = re.compile(r"\bno (\w+ )?(file|lock|plug-in)\b")
_STORES = "STORE", "BASELINE", "CANDIDATE", "PLACE"
_STAND_INS = {
    **dict.fromkeys(_STORES, _STAND_IN),
    **dict.fromkeys(("A", "B", "MODEL", "SCENE"), f"{_STAND_IN}.xml"),
    "SWEEP": f"{_STAND_IN}.yaml",
}
_MODELS, _SWEEPS = frozenset({".urdf", ".xml"}), frozenset({".yaml", ".yml"})


class BeganError(BaseException):
    """A command made its first step, or asked another program or machine for something."""


def parse(line: str) -> None:
    """Parse a command line, its values too; raise an error that is the line's own."""
    words = shlex.split(line, comments=True)[1:]
    if error := misreading(ShownCommand("", 0, tuple(words))):
        raise ValueError(f"{line}: {error}")


def misreading(shown: ShownCommand) -> str:
    """Return why the parser does not take a command line; nothing if it does."""
    words = [word.replace(HOLE, "{}") for word in shown.words]
    if words[0] == _LEFT_OUT:  # of some command
        found = [_misreading([name, *words[1:]], shown) for name in command_modules()]
        return "" if not all(found) else found[0]
    words = [word for word in words if word != _LEFT_OUT]
    if words[0] == "{}" or (_is_placeholder(words[0]) and len(words) == 1):
        return ""
    if _is_placeholder(words[0]):
        words = ["examine", *words]
    error = _misreading(words, shown)
    if error and "{}" in words:  # one or more words, or none
        error = _misreading([word for word in words if word != "{}"], shown)
    return error


def _misreading(words: Sequence[str], shown: ShownCommand) -> str:
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            read(words)
    except typer.TyperException as error:
        said = error.format_message()
        lacks = said.startswith("Missing") or said.endswith("requires an argument.")
        return "" if (lacks and shown.mention) or _about_placeholder(said, words) else said
    except ContactlabError as error:
        return "" if _about_placeholder(str(error), words) else str(error)
    except typer.Exit:  # of --help and --version
        return ""
    return ""


def _about_placeholder(said: str, words: Sequence[str]) -> bool:
    return any(_is_placeholder(word) and word in said for word in words)


def _is_placeholder(word: str) -> bool:
    return _PLACEHOLDER.fullmatch(word) is not None


@cache
def _commands() -> Any:
    return typer.main.get_command(command_line())


def read(words: Sequence[str]) -> Any:
    """Return the context of the command that words name, with the values that they give."""
    words = complete_words(words)
    command = _commands()
    context = command.make_context("contactlab", list(words))
    while hasattr(command, "commands"):
        rest = [*getattr(context, "_protected_args", ()), *context.args]
        if not rest or (rest[0] not in command.commands and command.invoke_without_command):
            break
        name, command, rest = command.resolve_command(context, rest)
        context = command.make_context(name, rest, parent=context)
    return context


@cache
def _parameters() -> dict[tuple[str, str], Parameter]:
    """Return how each parameter of each command is described."""
    return {
        (command.name, own.name): described_type(own)[1]
        for module in command_modules()
        for command in commands_of(module)
        for own in inspect.signature(command.function).parameters.values()
    }


@dataclass
class Trial:
    """One command line in a folder of its own, with what stands in for files that it names."""

    shown: ShownCommand
    folder: Path
    store: Path  # a small one, of the stand-in
    real: bool = True  # all that it names is the project's own
    _refused: list[tuple[str, list[str]]] = field(default_factory=list[tuple[str, list[str]]])

    def refusal(self) -> str:
        """Return why a command refuses a line before its first step; nothing if it does not."""
        words = [word.replace(HOLE, "{}") for word in self.shown.words if word != _LEFT_OUT]
        if self.shown.words[0] == _LEFT_OUT or misreading(self.shown):
            return misreading(self.shown)
        refused = self._try_words(words)
        if refused and "{}" in words:  # one or more words, or none
            refused = self._try_words([word for word in words if word != "{}"])
        return refused

    def _try_words(self, words: list[str]) -> str:
        try:
            with contextlib.redirect_stderr(io.StringIO()):
                context = read(words)
        except (ContactlabError, typer.TyperException, typer.Exit):
            return ""  # a placeholder, a mention or a question for help: there is nothing to run
        with contextlib.chdir(self.folder):
            return self._run(self._filled(words, context))

    def _filled(self, words: Sequence[str], context: Any) -> list[str]:
        """Return the words with stand-ins for placeholders, having made what they name."""
        name = context.command_path.removeprefix("contactlab").strip()
        stands = dict[str, str]()
        for own, given in context.params.items():
            parameter = _parameters().get((name, own))
            for value in given if isinstance(given, (list, tuple)) else [given]:
                if parameter and isinstance(value, (str, Path)):
                    stands[str(value)] = self._stand_in(str(value), parameter)
        if any(_is_placeholder(word) or "://" in word or ":" in word for word in words):
            self.real = False
        return [stands.get(word, word) for word in words]

    def _stand_in(self, value: str, parameter: Parameter) -> str:
        """Make what a value names, if it is missing; return the value that names it."""
        metavar = parameter.metavar or ""
        if value == "RUN":
            return contactlab.open(str(self.store)).table["run_id"].to_pylist()[0]
        value = _STAND_INS.get(value, value)
        path = Path(value)
        named_input = isinstance(parameter, Argument)
        if isinstance(parameter, Option) and parameter.short == "-o":
            return value
        if path.is_absolute() or "://" in value or ".." in path.parts or path.exists():
            return value
        if path.parts and (ROOT / path).exists():
            self._copy(path)
        elif path.suffix in _MODELS and named_input:
            self._write(path, MODEL)
        elif path.suffix in _SWEEPS and named_input:
            self._write(path, SWEEP)
            self._write(path.with_name(f"{_STAND_IN}.xml"), MODEL)
        elif any(each in metavar for each in _STORES) or (named_input and "/" in value):
            self.real = False
            shutil.copytree(self.store, path)
        elif "FILE" in metavar or "FOLDER" in metavar:
            self.real = False
        return value

    def _copy(self, path: Path) -> None:
        """Copy what the project has into the folder, a file with those beside it."""
        source = ROOT / path
        if source.is_dir():
            shutil.copytree(source, path, dirs_exist_ok=True)
        elif path.parent.parts:
            shutil.copytree(source.parent, path.parent, dirs_exist_ok=True)
        else:
            shutil.copy(source, path)

    def _write(self, path: Path, text: str) -> None:
        self.real = False
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def _run(self, words: Sequence[str]) -> str:
        words = complete_words(words)
        app = command_line(words[0])
        said = io.StringIO()
        try:
            with (
                _nothing_begins(self._refused),
                contextlib.redirect_stdout(said),
                contextlib.redirect_stderr(said),
            ):
                app(words, prog_name="contactlab", standalone_mode=False)
        except BeganError:
            return ""
        except ContactlabError as error:
            return str(error) if self._is_its_own(error) else ""
        return ""

    def _is_its_own(self, error: ContactlabError) -> bool:
        """Return whether an error is the line's: not the stand-ins', the machine's, or a result."""
        said = str(error)
        refused = [found for found in self._refused if found[0][:1] != "-" and found[0] in said]
        known = [names for _, names in refused if names]
        of_words = isinstance(error, CommandLineError | SweepFileError) and not self.shown.mention
        if error.exit_code not in (2, 3) or isinstance(error, ClusterError):
            return False
        if self.real:
            away = isinstance(error, EngineError | OutputError) or "not installed" in said
            away = away or self.shown.mention
            return bool(known) or not away
        words = [word.replace(HOLE, "{}") for word in self.shown.words]
        if (
            isinstance(error, StoreError)
            or _about_placeholder(said, words)
            or _MISSING.search(said)
        ):
            return False
        if any(_STAND_IN in name for names in known for name in names):
            return False
        return of_words or bool(known)


@contextlib.contextmanager
def _nothing_begins(refused: list[tuple[str, list[str]]]) -> Generator[None]:
    """Stop a command at its first step; note which names it refuses, and what it knows instead."""

    def begin(*_: object, **__: object) -> None:
        raise BeganError

    def close(name: str, known: Sequence[str], *rest: Any, **given: Any) -> list[str]:
        refused.append((name, [*known]))
        return look(name, known, *rest, **given)

    look = difflib.get_close_matches
    steps = [(mujoco, name) for name in ("mj_step", "mj_step1", "mj_step2")]
    steps += [(type(engine), "roll_out") for engine in ENGINES.values()]
    steps += [(windows, "Batch"), (mujoco_batch, "Batch")]
    others = [(LocalPool, "run"), (connection, "_connect_ray"), (urllib.request, "urlopen")]
    # `--mujoco` replaces the process by another Python, if its environment exists already.
    others += [(subprocess, "run"), (subprocess.Popen, "__init__"), (os, "execve")]
    with contextlib.ExitStack() as stack:
        for owner, name in [*steps, *others]:
            stack.enter_context(patch.object(owner, name, begin))
        stack.enter_context(patch.object(difflib, "get_close_matches", close))
        stack.enter_context(patch.dict(os.environ))
        yield
