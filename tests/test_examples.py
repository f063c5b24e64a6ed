"""The notebook runs from top to bottom, as a reader would run it."""

import ast
import json
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.long

NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples").glob("*.ipynb"))


def cells(notebook: Path) -> list[str]:
    """Return the sources of a notebook's code cells."""
    content = json.loads(notebook.read_text(encoding="utf-8"))
    return ["".join(each["source"]) for each in content["cells"] if each["cell_type"] == "code"]


def run(cell: str, names: dict[str, Any]) -> Any:
    """Run a cell and return the value of its last expression, which a notebook shows."""
    body = ast.parse(cell).body
    last = body.pop() if isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), "cell", "exec"), names)  # noqa: S102 - it is ours
    if not isinstance(last, ast.Expr):
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)  # noqa: S307


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """What each cell of the first look shows."""
    names: dict[str, Any] = {}
    [notebook] = NOTEBOOKS
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("notebook"))
        return [run(cell, names) for cell in cells(notebook)]


def test_every_cell_shows_something(shown: list[Any]) -> None:
    assert len(shown) == 6
    assert all(repr(each) for each in shown)


def test_a_store_shows_its_labels(shown: list[Any]) -> None:
    store = shown[0]
    assert "9 runs of ball_drop" in repr(store)
    assert len(repr(store)) < 200
    html = getattr(store, "_repr_html_")()  # noqa: B009 - its name looks private
    for label, count in store.manifest.labels.items():
        assert f"{count} {label}" in repr(store)
        assert f"<td>{label}</td><td>{count}</td>" in html


def test_labels_have_reasons(shown: list[Any]) -> None:
    assert all(reason for _, _, reason in shown[2])
    assert shown[2][0][0] != "stable"


def test_a_notebook_is_stored_without_outputs() -> None:
    for notebook in NOTEBOOKS:
        content = json.loads(notebook.read_text(encoding="utf-8"))
        outputs = [each["outputs"] for each in content["cells"] if each["cell_type"] == "code"]
        assert not any(outputs)
