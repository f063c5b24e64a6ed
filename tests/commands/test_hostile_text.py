"""What a model or a store says is shown by every command, and obeyed by none."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.attack.mutations import redo

from contactlab.command_line.terminal import print_csv

NAME = "x&#10;::error::boom&#x9b;31m&#x202e; @admin ##[add-mask]1 :x: [red]b[/red]"
MODEL = f"""
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body pos="0 0 0.12"><freejoint/><geom name="{NAME}" size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
SWEEP = """
version: 1
scene: ./hostile.xml
duration: 0.2
axes: {timestep: [1.0e-3, 2.0e-2]}
expect:
  - {label: tunneling, reason: "::error::boom\\e[31m"}
"""


@pytest.fixture
def hostile(contactlab: Callable[..., Any], tmp_path: Path) -> Path:
    """A store of a model whose geom has a hostile name."""
    (tmp_path / "hostile.xml").write_text(MODEL)
    (tmp_path / "hostile.yaml").write_text(SWEEP)
    code, out, err = contactlab("sweep", "hostile.yaml", "-o", "store", "--workers", "0")
    assert code == 1
    check(out + err)
    return tmp_path / "store"


def check(printed: str) -> None:
    """Check that nothing in an output of commands is obeyed."""
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", printed)
    assert "##[" not in printed
    assert not [line for line in printed.splitlines() if line.strip().startswith("::")]


FEW = [("show", "store"), ("show", "store", "RUN"), ("verify", "other")]
MORE = [
    ("show", "store", "RUN", "--format", "json"),
    ("compare", "store", "store"),
    ("compare", "store", "other", "--format", "junit"),
    ("report", "store", "-o", "page.html"),
    ("compare", "there", "other", "--update"),
]


@pytest.mark.long
@pytest.mark.parametrize("commands", [FEW, pytest.param(MORE, marks=pytest.mark.night)])
def test_hostile_names_are_shown(
    contactlab: Callable[..., Any], hostile: Path, commands: list[tuple[str, ...]]
) -> None:
    other = hostile.with_name("other")
    shutil.copytree(hostile, other)
    manifest = json.loads((other / "manifest.json").read_text())
    manifest["files"]["a\n::error::z\x1b"] = "0" * 64
    (other / "manifest.json").write_text(json.dumps(manifest))
    summary = contactlab("show", "store").out
    (run,) = re.findall(r"contactlab show store ([0-9a-f]{8})", summary)
    for command in commands:
        _, out, err = contactlab(*(run if each == "RUN" else each for each in command))
        assert "Traceback" not in err
        check(out + err)


def test_a_markup_is_no_markup(contactlab: Callable[..., Any], tmp_path: Path) -> None:
    code, _, err = contactlab("show", ":x: [red]::y[/red]\n::error::z")
    assert code == 3
    assert ":x: [red]::y[/red]\n\\u003a:error::z" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.night
def test_a_page_of_hostile_labels(contactlab: Callable[..., Any], store: Path) -> None:
    """An escape sequence in a label ended the process that draws the charts."""
    path = store / "runs.parquet"
    table = pq.read_table(path)
    place = table.schema.get_field_index("label")
    labels = pa.array(["a\x1b[31m\u202e<b>"] * table.num_rows)
    pq.write_table(table.set_column(place, table.schema.field(place), labels), path)
    redo(store, 2)
    code, out, err = contactlab("report", str(store), "-o", "page.html")
    assert (code, "Traceback" in err) == (0, False)
    check(out + err)
    assert not re.search("[\x1b\u202e]", (store.parent / "page.html").read_text(encoding="utf-8"))


def test_no_cell_of_a_table_is_computed(capsys: pytest.CaptureFixture[str]) -> None:
    print_csv(["=1+1"], [["=HYPERLINK(1)"], ["@SUM(1)"], ["+1"], ["-2+3"], [-1.5], ["-"]])
    assert capsys.readouterr().out.splitlines()[1:] == [
        "'=HYPERLINK(1)",
        "'@SUM(1)",
        "'+1",
        "'-2+3",
        "-1.5",
        "-",
    ]
