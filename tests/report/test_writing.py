"""Pages and figures as files."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactlab.compare import compare
from contactlab.errors import OutputError, SweepFileError
from contactlab.report import PageRequest, write_figures, write_page
from contactlab.report.impact_figures import bouncing_runs, first_impacts
from contactlab.report.report_data import read_report_data
from contactlab.store import Store
from contactlab.tradeoff import Criteria

Swept = Callable[[str], Store]

ENGINE_FREE = """
import sys
from pathlib import Path

sys.modules["mujoco"] = None
from contactlab.store import Store
from contactlab.report import write_page

write_page(Store.open(Path(sys.argv[1])), Path(sys.argv[2]))
print(sorted({"contactlab.run", "contactlab.scene", "contactlab.engines"} & set(sys.modules)))
"""


def test_the_same_store_gives_the_same_bytes(swept: Swept, tmp_path: Path) -> None:
    for name in ("one.html", "two.html"):
        write_page(swept("bounce"), tmp_path / name)
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()
    for name in ("one", "two"):
        write_figures(swept("bounce"), tmp_path / name, ("png", "svg", "pdf"))
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert len(files) >= 12
    assert files == sorted(path.name for path in (tmp_path / "two").iterdir())
    for name in files:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_no_engine_is_loaded(swept: Swept, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENGINE_FREE, str(swept("bounce").path), str(tmp_path / "page.html")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_figures_are_those_that_the_store_holds(swept: Swept, tmp_path: Path) -> None:
    written = write_figures(swept("bounce"), tmp_path, ("svg",))
    assert {path.stem for path in written} == {
        "labels",
        "error",
        "work-precision",
        "bounces",
        "effects",
    }
    assert all(path.read_text().startswith("<svg") for path in written)


def test_bounces_come_as_high_as_restitution_says(swept: Swept) -> None:
    """A bounce is seen up to a step late, as the scene's oracle derives: e within 0.07."""
    gathered = read_report_data(swept("bounce"))
    found = bouncing_runs(gathered.store, gathered.axes, ~gathered.outcomes.failed)
    assert {each.setting for each in found} >= {"restitution 0.9"}
    for each in found:
        assert np.sqrt(each.ratios[0]) == pytest.approx(each.restitution, abs=0.07)


def test_a_vertical_drop_has_no_cone(swept: Swept) -> None:
    assert first_impacts(swept("bounce")) == []


@pytest.mark.parametrize("formats", [("gif",), ("png", "jpg")])
def test_unknown_formats_are_refused(
    swept: Swept, tmp_path: Path, formats: tuple[str, ...]
) -> None:
    with pytest.raises(OutputError, match="write some of png, svg, pdf"):
        write_figures(swept("bounce"), tmp_path / "figures", formats)
    assert not (tmp_path / "figures").exists()


def test_a_page_that_cannot_be_written_leaves_nothing(swept: Swept, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        write_page(swept("bounce"), tmp_path / "missing" / "page.html")
    assert list(tmp_path.iterdir()) == []


def test_a_tolerance_of_nothing_is_refused(swept: Swept, tmp_path: Path) -> None:
    ask = PageRequest(Criteria(None, {"penetration": 1.0}))
    with pytest.raises(SweepFileError, match="penetration_max"):
        write_page(swept("bounce"), tmp_path / "page.html", ask)
    assert list(tmp_path.iterdir()) == []


def test_missing_libraries_are_named(
    swept: Swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("contactlab.report.vega_rendering.find_spec", lambda _: None)
    with pytest.raises(OutputError, match=r"contactlab\[figures\]"):
        write_page(swept("bounce"), tmp_path / "page.html")


def test_above_its_size_a_page_has_sums(
    swept: Swept, tmp_path: Path, visit: Callable[..., Any]
) -> None:
    """Cells are those of all runs, though few of them are on the page."""
    store = swept("tradeoff")
    full = write_page(store, tmp_path / "full.html")
    summed = write_page(store, tmp_path / "summed.html", PageRequest(most_bytes=1000))
    assert full.notes == ()
    assert "more than fits" in summed.notes[0]
    told: list[list[str]] = []
    for name in ("full", "summed"):
        seen = visit(tmp_path / f"{name}.html", "#what=oracle_error&x=timestep&y=integrator")
        seen.page.locator("#map-data summary").click()
        told.append(seen.page.locator("#map-data td").all_inner_texts())
        assert seen.complaints == []
    assert len(told[0]) == 10
    assert told[0] == told[1]
    page = (tmp_path / "summed.html").read_text()
    columns = page.split('id="columns">')[1].split("</script>")[0]
    lengths = {name: length for name, _, length in json.loads(columns)["columns"]}
    assert lengths["label"] <= store.columns.runs
    assert "Summed up" in page


def test_a_baseline_stands_beside(swept: Swept, tmp_path: Path) -> None:
    before = tmp_path / "before"
    shutil.copytree(swept("bounce").path, before)
    ask = PageRequest(baseline=Store.open(before))
    write_page(swept("bounce"), tmp_path / "page.html", ask)
    page = (tmp_path / "page.html").read_text()
    assert f"contactlab compare {before} {swept('bounce').path}" in page
    assert compare(before, swept("bounce").path).headline in page
    versus = page.split('id="versus"')[1].split("</section>")[0]
    assert versus.count("<svg") == 2, "labels, and the error"
    for title in ("baseline", "candidate", "difference"):
        assert versus.count(f">{title}</text>") == 2
