"""A command is one function: the command line reads what Python takes, by the same names."""

import inspect
from collections.abc import Iterator
from dataclasses import replace
from functools import wraps
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
import typer.main
from typer.testing import CliRunner

import contactlab
import contactlab.commands
from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Command, Option, command, find_command
from contactlab.command_line.main import command_line
from contactlab.command_line.modules import command_modules, commands_of
from contactlab.command_line.parser import adapt_command
from contactlab.errors import EngineError, SweepFileError

COMMANDS = {each.name: each for name in command_modules() for each in commands_of(name)}
# Packages have these names, so that their commands are with the others, in `contactlab.commands`.
OF_PACKAGES = {
    "advisories",
    "advisories check",
    "advisories find",
}
# Values of the command line that are accepted wherever one is needed.
NEEDED = "value"


def parsed(words: str) -> Any:
    """Return what the command line makes of a command, as typer has it."""
    found: Any = typer.main.get_command(command_line())
    for word in words.split():
        found = found.commands[word]
    return found


def own(words: str) -> list[inspect.Parameter]:
    """Return the parameters of the function that Python calls."""
    return list(inspect.signature(COMMANDS[words].function).parameters.values())


def read(declared_command: Command, *words: str) -> dict[str, Any]:
    """Return what the function is called with, and all that it leaves to defaults."""
    calls: list[dict[str, Any]] = []
    signature = inspect.signature(declared_command.function)

    @wraps(declared_command.function)
    def called(**given: Any) -> None:
        bound = signature.bind(**given)
        bound.apply_defaults()
        calls.append(bound.arguments)

    app = typer.Typer()
    silent = replace(
        declared_command,
        function=called,
        formats=dict.fromkeys(declared_command.formats, lambda *_: None),
        failure=lambda *_: None,
    )
    app.command()(adapt_command(silent))
    done = CliRunner().invoke(app, list(words), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    (found,) = calls
    return found


def test_every_command_of_the_command_line_is_declared() -> None:
    def listed(found: Any, words: tuple[str, ...] = ()) -> Iterator[str]:
        for name, inner in getattr(found, "commands", {}).items():
            yield from listed(inner, (*words, name))
        if not hasattr(found, "commands") or found.invoke_without_command:
            yield " ".join(words)

    assert set(listed(typer.main.get_command(command_line()))) == set(COMMANDS)
    assert len(COMMANDS) > 20


@pytest.mark.parametrize("words", COMMANDS)
def test_python_has_the_very_function_that_the_command_line_calls(words: str) -> None:
    if words in OF_PACKAGES:
        module = attrgetter(words.split(maxsplit=1)[0])(contactlab.commands)
        found = getattr(module, words.rpartition(" ")[2])
    else:
        found = attrgetter(words.replace(" ", "."))(contactlab)
    assert found is COMMANDS[words].function
    assert find_command(found) is COMMANDS[words]


@pytest.mark.parametrize("words", COMMANDS)
def test_parameters_have_the_same_names(words: str) -> None:
    """Options are spelled with dashes; `--format` says how the command line prints the result."""
    shown = {each.name: each for each in parsed(words).params if each.name != "help"}
    if len(COMMANDS[words].formats) > 1:
        assert shown.pop("format").opts == ["--format"]
    assert list(shown) == [each.name for each in own(words)]
    for name, parameter in shown.items():
        if parameter.param_type_name == "option":
            assert f"--{name.rstrip('_').replace('_', '-')}" in parameter.opts


@pytest.mark.parametrize("words", COMMANDS)
def test_parameters_have_the_same_defaults(words: str) -> None:
    """With the words that a command needs and no others, it is called as Python calls it so."""
    given: list[str] = []
    for each in own(words):
        if each.default is each.empty:
            is_named = each.kind is each.KEYWORD_ONLY
            given += [f"--{each.name.replace('_', '-')}", NEEDED] if is_named else [NEEDED]
    found = read(COMMANDS[words], *given)
    for each in own(words):
        if each.default is each.empty:
            assert found[each.name] in (NEEDED, [NEEDED], Path(NEEDED))
        else:
            assert found[each.name] == each.default
            assert type(found[each.name]) is type(each.default)


@pytest.mark.parametrize("words", COMMANDS)
def test_every_parameter_is_explained_in_help(words: str) -> None:
    for parameter in parsed(words).params:
        assert parameter.help
    assert inspect.getdoc(COMMANDS[words].function)


@pytest.mark.parametrize("words", ["examine", "effects", "tradeoff", "tune", "sweep"])
def test_the_task_is_stated_by_the_same_parameters(words: str) -> None:
    """A sweep judges nothing, so it has no observed body and no tolerance."""
    shared = {
        "keyframe": opt.Keyframe,
        "drive": opt.Drive,
        "duration": opt.Duration,
        "observe": opt.Observe,
        "tolerance": opt.Tolerance,
    }
    if words == "sweep":
        del shared["observe"], shared["tolerance"]
    found = {each.name: each.annotation for each in own(words)}
    assert {name: found[name] for name in found if name in shared} == shared
    assert all(found[name] is shared[name] for name in shared)
    assert [name for name in found if name in shared] == list(shared)
    assert not {"start", "watch", "within", "must"} & set(found)


def test_a_task_is_the_same_as_typed_and_as_data() -> None:
    typed_in = opt.task_of("home", "hold", "500ms", ["box"], ["slip=1mm", "spin=5%"])
    assert opt.task_of("home", "hold", 0.5, ("box",), {"slip": 1e-3, "spin": 0.05}) == typed_in
    assert opt.task_of(tolerance="1mm") == opt.task_of(tolerance=["1mm"])
    assert opt.task_of(observe="box") == opt.task_of(observe=["box"])
    for wrong in ({"slip": -1}, {"": 1}, {"slip": float("nan")}):
        with pytest.raises(SweepFileError, match="is not a tolerance"):
            opt.task_of(tolerance=wrong)
    with pytest.raises(SweepFileError, match="is not a time"):
        opt.task_of(duration=-1)


def test_words_become_values() -> None:
    words = ["case", "--set", "a=1", "--set", "b=2", "--limit", "3", "--fresh", "-o", "here"]
    found = read(COMMANDS["sweep"], *words)
    assert found["source"] == ["case"]
    assert (found["set"], found["limit"]) == (["a=1", "b=2"], 3)
    assert (found["fresh"], found["repair"], found["output"]) == (True, False, "here")
    bundled = read(COMMANDS["parity"], "--from", "there", "--with", "a=1")
    assert (bundled["from_"], bundled["with_"]) == (Path("there"), ["a=1"])


def test_a_parameter_that_is_not_described_is_refused() -> None:
    @command("extend")
    def ring(bell: str, times: Annotated[int, Option("N", "How often.")] = 1) -> None:
        del bell, times

    with pytest.raises(TypeError, match="bell"):
        adapt_command(find_command(ring))


@pytest.mark.long
def test_python_prints_nothing(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(tmp_path / "summary"))
    opened: Any = contactlab.show(store)
    run = opened.table["run_id"][0].as_py()
    assert contactlab.show(store, run) == opened.record(run)
    replayed: Any = contactlab.verify(store, run)
    assert replayed.equal
    assert contactlab.verify(store).sound
    written: Any = contactlab.compare("kept", store, update=True)
    assert written.runs == 4
    assert contactlab.compare("kept", opened, output=["compared.md"]).exit_code == 0
    assert contactlab.init("ball_drop", output="first.yaml") == Path("first.yaml")
    planned: Any = contactlab.sweep("first.yaml", plan=True)
    assert planned.runs > 0
    assert capfd.readouterr() == ("", "")
    assert not (tmp_path / "summary").exists()


def test_a_listing_is_rows_by_column() -> None:
    listing = contactlab.list("scenes")
    (ball,) = [row for row in listing if row["scene"] == "ball_drop"]
    assert (
        ball["duration"]
        == listing[[row["scene"] for row in listing].index("ball_drop")]["duration"]
    )
    assert listing.header[-1] == "duration [s]"
    html = getattr(listing, "_repr_html_")()  # noqa: B009 - its name looks private
    assert html.count("<tr>") == len(listing) + 1


def test_progress_is_reported_to_a_function(tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    sweep: Any = contactlab.sweep
    store = sweep(
        {"version": 1, "scene": "ball_drop", "duration": 0.05},
        output=tmp_path / "store",
        workers=0,
        progress=lambda *counts: done.append(counts),  # pyright: ignore[reportUnknownLambdaType]
    )
    assert len(store.runs) == 1
    assert done[-1] == (1, 1)


@pytest.mark.long
def test_another_mujoco_is_refused_before_anything_runs(tmp_path: Path) -> None:
    """Python has one already; the command line starts a process with another."""
    for function in (contactlab.sweep, contactlab.stability):
        call: Any = function
        with pytest.raises(EngineError, match="--mujoco 3"):
            call("bounce", output=tmp_path / "store", mujoco="3.3.0")
    assert not list(tmp_path.iterdir())
