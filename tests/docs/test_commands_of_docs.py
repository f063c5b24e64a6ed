"""Commands that files of the project show exist, with their options and names; sweeps are valid."""

import os
import re
import shlex
import shutil
import subprocess
import sysconfig
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.docs.shown_commands import ShownCommand, commands_in, shown_commands
from tests.docs.tried_commands import MODEL, ROOT, SWEEP, Trial, misreading

import contactlab
from contactlab.command_line.modules import command_modules, commands_of
from contactlab.plan.sweep_file import read_sweep
from contactlab.resources import scene_names
from contactlab.run.sweep_request import SceneLoader

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FENCES = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
EXAMPLES = [
    ShownCommand(f"help of {command.name}", 1, tuple(shlex.split(line, comments=True)))
    for module in command_modules()
    for command in commands_of(module)
    for line in command.examples
]
SHOWN = [*shown_commands(ROOT), *EXAMPLES]
AT_ONCE = [
    shown for shown in SHOWN if shown.file.startswith((".ci/smoke", ".pre-commit", "Makefile"))
]

Try = Callable[[ShownCommand], str]


def blocks(page: Path, *languages: str) -> list[str]:
    found = FENCES.findall(page.read_text(encoding="utf-8"))
    return [text for language, text in found if language in languages]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of two runs of the model that stands in for others."""
    folder = tmp_path_factory.mktemp("standin")
    (folder / "standin.xml").write_text(MODEL)
    (folder / "standin.yaml").write_text(SWEEP)
    contactlab.sweep(str(folder / "standin.yaml"), output=str(folder / "store"), workers=0)
    return folder / "store"


@pytest.fixture
def refusal(tmp_path: Path, store: Path, _registries_restored: None) -> Try:
    """Return why a command line is refused before its first step; nothing if it is not."""

    def refused(shown: ShownCommand) -> str:
        folder = tmp_path / f"trial-{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        return Trial(shown, folder, store).refusal()

    return refused


def test_the_parser_takes_every_line() -> None:
    assert [f"{shown}: {error}" for shown in SHOWN if (error := misreading(shown))] == []


@pytest.mark.parametrize("shown", AT_ONCE, ids=str)
def test_a_line_of_scripts_is_not_refused(shown: ShownCommand, refusal: Try) -> None:
    assert refusal(shown) == ""


@pytest.mark.long
@pytest.mark.parametrize("file", sorted({shown.file for shown in SHOWN if shown not in AT_ONCE}))
def test_no_line_of_a_file_is_refused(file: str, refusal: Try) -> None:
    lines = [shown for shown in SHOWN if shown.file == file]
    assert [f"{shown}: {said}" for shown in lines if (said := refusal(shown))] == []


def test_lines_are_found_wherever_they_stand() -> None:
    files = {shown.file for shown in SHOWN}
    assert {".ci/smoke", "Makefile", "action.yml", ".github/action/judge", "README.md"} <= files
    assert {".pre-commit-hooks.yaml", ".pre-commit-config.yaml", "docs/how-to/tune.md"} <= files
    assert {"docs/skills/contactlab/SKILL.md", "examples/grasp_gate/grasp-gate.yaml"} <= files
    assert {"cli/contactlab/commands/list.py", "examples/onnx_policy.py"} <= files


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("a.md", "```sh\n$ contactlab sweep a.yaml \\\n  --plan  # runs nothing\n```\n", [(2, 3)]),
        ("a.md", "Call\n`contactlab list\nscenes`, or not.\n", [(2, 2)]),
        ("a.md", "```python\ncontactlab sweep\n```\n", []),
        ("a.yaml", "jobs:\n  - run: contactlab lint a.xml\n  - name: contactlab lint\n", [(2, 2)]),
        ("a.yaml", "on:\n  run: |\n    cd a && contactlab sweep a.yaml | tail\n", [(3, 2)]),
        ("a.yaml", "about: written by `contactlab lock a.yaml`\n", [(1, 2)]),
        ("a", '#!/bin/sh\nA=1 exec .venv/bin/contactlab verify "$a b" >/dev/null\n', [(2, 2)]),
        ("a", "# contactlab is a program\npip install contactlab mujoco\n", []),
        ("Makefile", "a:\n\t$(BIN)/contactlab sweep bounce\n", [(2, 2)]),
        ("a.py", "'''Run it.\n\n    contactlab sweep a.yaml -o b\n'''\n", [(3, 4)]),
        ("a.py", "x = 1\nsay(f'see `contactlab explain {word}`')\n", [(2, 2)]),
    ],
)
def test_a_line_is_read_as_its_file_has_it(
    name: str, text: str, found: list[tuple[int, int]], tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    shown = commands_in(tmp_path / name, name)
    assert [(each.line, len(each.words)) for each in shown] == found


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("sweep robot.yaml --plann", "--plann"),
        ("swep robot.yaml", "swep"),
        ("sweep bonce -o before", "'bonce'"),
        ("compare before after more", "more"),
        ("compare before", "CANDIDATE"),
        ("compare before after --remeasure often", "often"),
        ("examine robot.xml --check timestep", "'timestep'"),
        ("examine box_stack --check timestep", "'timestep'"),
        ("list lables", "'lables'"),
        ("explain chater", "'chater'"),
        ("list schemas sweeep", "'sweeep'"),
        ("sweep bounce --set timestp=1e-3", "timestp"),
        ("tune robot.xml --error lots", "lots"),
        ("stability free_fal", "'free_fal'"),
        ("parity slide --against wrap", "'wrap'"),
        ("tradeoff grid.yaml --metric reallity", "reallity"),
    ],
)
def test_a_line_that_is_wrong_is_found(line: str, said: str, tmp_path: Path, refusal: Try) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    page = tmp_path / "README.md"
    page.write_text(f"{text}\n```sh\ncontactlab {line}\n```\n")
    found = [shown for shown in commands_in(page, page.name) if shown.words == tuple(line.split())]
    assert [said in refusal(shown) for shown in found] == [True]


@pytest.mark.long
@pytest.mark.parametrize("script", ["smoke", "compare"])
def test_a_script_of_ci_ends_well(script: str, tmp_path: Path) -> None:
    """Run as it is, in a folder that has what it takes; `make bounce` does as the Makefile says."""
    commands = Path(sysconfig.get_path("scripts"))
    for place in (".ci",):
        shutil.copytree(ROOT / place, tmp_path / place)
    (tmp_path / ".venv").symlink_to(commands.parent)
    make = tmp_path / "bin" / "make"
    make.parent.mkdir()
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (rule,) = re.findall(r"^bounce:.*\n\t(.*)$", makefile, re.MULTILINE)
    make.write_text(f"#!/bin/sh\n[ $* = bounce ] && {rule.replace('$(BIN)', '.venv/bin')}\n")
    make.chmod(0o755)
    path = os.pathsep.join([str(make.parent), os.environ["PATH"]])
    done = subprocess.run(
        ["sh", tmp_path / ".ci" / script],
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


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
