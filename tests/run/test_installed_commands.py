"""Commands that an installed package adds."""

from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.long

MINE = """
from typing import Annotated

from contactlab.command_line.declaration import Argument, Option, command
from contactlab.errors import SweepFileError


@command("extend", formats={"text": lambda sound, given: print(sound)})
def ring(
    bell: Annotated[str, Argument("BELL", "Which one.")],
    times: Annotated[int, Option("N", "How often.")] = 1,
) -> str:
    \"\"\"Ring a bell.\"\"\"
    if times < 1:
        raise SweepFileError("a bell rings once at least")
    return " ".join([bell] * times)


def knoll() -> None:
    \"\"\"It is not declared.\"\"\"
"""


def test_an_installed_command_stands_among_our_own(command: Any, tmp_path: Path) -> None:
    site = tmp_path / "site"
    metadata = site / "bell-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: bell\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(
        "[contactlab.commands]\nring = bell:ring\nknell = bell:knell\nknoll = bell:knoll\n"
    )
    (site / "bell.py").write_text(MINE)

    def run(*words: str) -> tuple[int, str, str]:
        return command.run(*words, first=site)

    code, out, err = run("--help")
    assert code == 0, err
    assert "Ring a bell." in out
    assert err.startswith("warning: there is no command knell: ")
    assert "\nwarning: there is no command knoll: " in err
    assert run("ring", "ding", "--times", "2")[:2] == (0, "ding ding\n")
    code, out, err = run("ring", "ding", "--times", "0")
    assert (code, out) == (2, "")
    assert err.endswith("error: a bell rings once at least\n")
