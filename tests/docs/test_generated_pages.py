"""The pages of docs/reference that list names are those that `make schemas` writes."""

from pathlib import Path

import mujoco
import pytest
from docs.generate import FOLDER, KEYS, PAGES, list_commands, write_page

from contactlab.command_line.modules import command_modules, commands_of
from contactlab.command_line.parser import adapt_command

PINNED = Path(__file__).parents[2] / ".ci/constraints/run.txt"


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_current(name: str) -> None:
    pinned = f"mujoco=={mujoco.__version__} " in PINNED.read_text(encoding="utf-8")
    if name == "parameters" and not pinned:
        pytest.skip("other releases of MuJoCo have other options")
    page = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert page == write_page(PAGES[name]), "run make schemas"


def test_the_page_of_keys_has_each_part_of_each_file_once() -> None:
    headings = [line for line in write_page(KEYS).splitlines() if line.startswith("#")]
    assert {"## Sweep file", "## scene.yaml", "### Refine", "### PairEntry"} <= set(headings)
    assert len(headings) == len(set(headings))


def test_every_option_of_every_command_is_listed() -> None:
    text = "\n".join(list_commands())
    for module in command_modules():
        for command in commands_of(module):
            for parameter in adapt_command(command).__dict__["__signature__"].parameters.values():
                flags = getattr(parameter.default, "param_decls", None) or ("--format",)
                assert flags[-1] == "--format" or f"`{flags[-1]}" in text, (command.name, flags)
