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
from tests.reporting.conftest import run

from contactlab.comparison.compare_stores import compare_stores
from contactlab.errors import OutputError, SweepFileError
from contactlab.page.paper_figures import bounce_panels, bouncing_runs, first_impacts
from contactlab.page.report_files import write_figures, write_page
from contactlab.pareto.criteria import Criteria
from contactlab.reporting.report import PageRequest, read_report_data
from contactlab.store.finished_store import Store

Swept = Callable[[str], Store]

WITHOUT_FILMS = PageRequest(traces=0)
BARE = """
import sys
from pathlib import Path

for absent in ("mujoco", "fontTools", "pikepdf"):
    sys.modules[absent] = None
from contactlab.store.finished_store import Store
from contactlab.page.report_files import write_page

write_page(Store.open(Path(sys.argv[1])), Path(sys.argv[2]))
print(sorted({"contactlab.run", "contactlab.scene", "contactlab.engines"} & set(sys.modules)))
"""


@pytest.mark.night
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


@pytest.mark.long
def test_a_page_needs_neither_engine_nor_extra(swept: Swept, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", BARE, str(swept("bounce").path), str(tmp_path / "page.html")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("[]\n", "")


@pytest.mark.long
def test_figures_are_those_for_which_the_store_has_data(swept: Swept, tmp_path: Path) -> None:
    written, missing = write_figures(swept("bounce"), tmp_path, ("svg",))
    assert list(missing) == ["cone", "stick-slip"]
    assert {path.stem for path in written} == {
        "labels",
        "error",
        "work-precision",
        "bounces",
        "effects",
    }
    assert all(path.read_text().startswith("<svg") for path in written)


def test_bounces_are_as_high_as_restitution_says(swept: Swept) -> None:
    """A bounce is seen up to a step late, as the scene's oracle derives: e within 0.07."""
    data = read_report_data(swept("bounce"))
    runs, _ = bouncing_runs(data.store, data.axes, ~data.labels.failed)
    assert {each.setting for each in runs} >= {"restitution 0.9"}
    for each in runs:
        assert np.sqrt(each.ratios[0]) == pytest.approx(each.restitution, abs=0.07)


def test_bouncing_runs_differ_in_one_axis_alone_and_name_the_others(swept: Swept) -> None:
    data = read_report_data(swept("bounce"))
    (axis, *others) = data.axes
    assert axis.name == "restitution"
    stable = ~data.labels.failed
    runs, shared = bouncing_runs(data.store, data.axes, stable)
    assert [each.setting for each in runs] == ["restitution 0.2", "restitution 0.9"]
    assert shared == "timestep 0.5 ms, drop_height 0.5 m"
    assert [each.peaks[0] for each in runs] == pytest.approx([0.5, 0.5], abs=0.01)
    title = bounce_panels(runs, shared)["hconcat"][0]["title"]["text"]
    assert title == f"all at {shared}"
    # Runs of other heights are not drawn together.
    apart = stable & (axis.codes == others[1].codes)
    runs, _ = bouncing_runs(data.store, data.axes, apart)
    assert len(runs) == 1


def test_a_vertical_drop_has_no_cone(swept: Swept) -> None:
    assert first_impacts(swept("bounce")) == []


OBLIQUE = """
version: 1
scene: oblique_impact
trace: all
checks: none
axes:
  angle: {values: [20, 45, 60, 70], role: scenario}
"""


def test_impacts_of_a_sphere_lie_on_their_side_of_the_cone(tmp_path: Path) -> None:
    """One that slips by less than mu (1 + e) v_n before it sticks at some step; others slide."""
    impacts = first_impacts(run(OBLIQUE, tmp_path))
    assert len(impacts) == 4
    for each in impacts:
        if abs(each["slip"] / each["bound"] - 1) > 0.2:
            assert (each["contact"] == "sticks") == (each["slip"] < each["bound"])


@pytest.mark.long
def test_impacts_of_a_body_that_turns_are_not_held_against_the_cone(tmp_path: Path) -> None:
    """How much of a slip friction must stop depends on how the body turns."""
    thrown = (
        "{version: 1, scene: cube_toss, trace: all, checks: none, axes: {recorded_run: [0, 2, 3]}}"
    )
    assert first_impacts(run(thrown, tmp_path)) == []


@pytest.mark.long
def test_a_held_mug_neither_bounces_nor_hits(swept: Swept) -> None:
    data = read_report_data(swept("grasp"))
    assert bouncing_runs(data.store, data.axes, ~data.labels.failed) == ([], "")
    assert first_impacts(data.store) == []


@pytest.mark.parametrize("formats", [("gif",), ("png", "jpg")])
def test_unknown_formats_are_refused(
    swept: Swept, tmp_path: Path, formats: tuple[str, ...]
) -> None:
    with pytest.raises(OutputError, match="choose from png, svg, pdf"):
        write_figures(swept("bounce"), tmp_path / "figures", formats)
    assert not (tmp_path / "figures").exists()


@pytest.mark.long
def test_a_page_that_cannot_be_written_leaves_no_file(swept: Swept, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        write_page(swept("bounce"), tmp_path / "missing" / "page.html", WITHOUT_FILMS)
    assert list(tmp_path.iterdir()) == []


def test_a_tolerance_of_an_unknown_metric_is_refused(swept: Swept, tmp_path: Path) -> None:
    request = PageRequest(Criteria(None, {"penetration": 1.0}))
    with pytest.raises(SweepFileError, match="penetration_max"):
        write_page(swept("bounce"), tmp_path / "page.html", request)
    assert list(tmp_path.iterdir()) == []


def test_figures_for_paper_name_their_extra_before_anything_is_written(
    swept: Swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in [name for name in sys.modules if name.startswith("contactlab.page")]:
        monkeypatch.delitem(sys.modules, module)
    for library in ("fontTools", "pikepdf"):
        monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(OutputError, match=r"needs .*, .*pip install 'fonttools.*' 'pikepdf"):
        write_figures(swept("bounce"), tmp_path / "figures", ["svg"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.night
def test_above_its_size_a_page_has_aggregated_cells(
    swept: Swept, tmp_path: Path, visit: Callable[..., Any]
) -> None:
    """Cells are those of all runs, though few of them are on the page."""
    store = swept("tradeoff")
    full = write_page(store, tmp_path / "full.html")
    aggregated = write_page(store, tmp_path / "aggregated.html", PageRequest(most_bytes=1000))
    assert full == ()
    assert "too many for one page" in aggregated[0]
    cells: list[list[str]] = []
    for name in ("full", "aggregated"):
        seen = visit(tmp_path / f"{name}.html", "#what=oracle_error&x=timestep&y=integrator")
        seen.page.locator("#map-data summary").click()
        cells.append(seen.page.locator("#map-data td").all_inner_texts())
        assert seen.complaints == []
    assert len(cells[0]) == 10
    assert cells[0] == cells[1]
    page = (tmp_path / "aggregated.html").read_text()
    columns = page.split('id="columns">')[1].split("</script>")[0]
    lengths = {name: length for name, _, length in json.loads(columns)["columns"]}
    assert lengths["label"] <= store.columns.runs
    assert "Aggregated" in page


@pytest.mark.long
def test_a_page_compares_with_a_baseline(swept: Swept, tmp_path: Path) -> None:
    before = tmp_path / "before"
    shutil.copytree(swept("bounce").path, before)
    request = PageRequest(traces=0, baseline=Store.open(before))
    write_page(swept("bounce"), tmp_path / "page.html", request)
    page = (tmp_path / "page.html").read_text()
    assert f"contactlab compare {before} {swept('bounce').path}" in page
    assert compare_stores(before, swept("bounce").path).headline in page
    comparison = page.split('id="comparison"')[1].split("</section>")[0]
    assert comparison.count("<svg") == 2, "labels, and the error"
    for title in ("baseline", "candidate", "difference"):
        assert comparison.count(f">{title}</text>") == 2
