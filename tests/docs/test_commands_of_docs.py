"""Commands that README and docs show exist, with their options; sweeps and Python are valid."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer.main

from contactlab.command_line.front_door import complete_words
from contactlab.command_line.main import command_line
from contactlab.plan.sweep_file import read_sweep
from contactlab.resources import scene_names
from contactlab.run.sweep_request import SceneLoader

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
SHELL = ("|", ">", "||", "&&", ";")
FENCES = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(page: Path, *languages: str) -> list[str]:
    found = FENCES.findall(page.read_text(encoding="utf-8"))
    return [text for language, text in found if language in languages]


def lines(page: Path) -> list[str]:
    """Return the command lines of a page; a line that ends in a backslash goes on."""
    texts = (each.replace("\\\n", " ") for each in blocks(page, "sh", "bash", "console"))
    told = (line.strip().removeprefix("$ ") for text in texts for line in text.splitlines())
    return [line for line in told if line.startswith("contactlab ")]


SHOWN = [pytest.param(line, id=f"{page.stem}: {line}") for page in PAGES for line in lines(page)]


def parse(line: str) -> None:
    """Parse a command line as the command does that it names; what is not known raises."""
    words = complete_words(shlex.split(line, comments=True)[1:])
    # What a pipe or a redirection follows is the shell's.
    words = words[: next((at for at, each in enumerate(words) if each in SHELL), len(words))]
    command: Any = typer.main.get_command(command_line())
    context = command.context_class(command)
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        if words[0] not in command.commands and command.invoke_without_command:
            break
        name, found, words = command.resolve_command(context, words)
        command, context = found, found.context_class(found, info_name=name, parent=context)
    command.make_parser(context).parse_args(words)


@pytest.mark.long
@pytest.mark.parametrize("line", SHOWN)
def test_a_command_has_the_options_that_are_shown(line: str) -> None:
    parse(line)


@pytest.mark.parametrize("line", ["contactlab sweep grasp --nonsense", "contactlab swep grasp"])
def test_what_does_not_exist_is_found(line: str) -> None:
    with pytest.raises(Exception, match=r"(?i)no (such|command)"):
        parse(line)


SWEEPS = [
    pytest.param(text, id=f"{page.stem} {at}")
    for page in PAGES
    for at, text in enumerate(blocks(page, "yaml"))
    if any(f"\nscene: {name} " in text.replace("\n", " \n") for name in scene_names())
]


@pytest.mark.parametrize("text", SWEEPS)
def test_a_sweep_of_a_shipped_scene_is_valid(text: str, tmp_path: Path) -> None:
    read_sweep(text, SceneLoader(tmp_path).vocabulary)


def test_the_sweep_of_the_readme_is_among_them() -> None:
    assert any(each.id == "README 0" for each in SWEEPS)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_compiles(page: Path) -> None:
    for text in blocks(page, "python"):
        compile(text, page.name, "exec")
