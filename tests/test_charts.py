"""Charts become pictures, or an error says why not."""

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from contactlab.errors import OutputError

pytest.importorskip("altair", reason="charts are an extra")
pytest.importorskip("vl_convert", reason="charts are an extra")

import vl_convert

from contactlab import charts
from contactlab.charts import SUFFIXES, check_figure, layer_of, save_figure, vega_bundle
from contactlab.page.heatmap import DIVERGING_COLORS

CHART = layer_of("points", [{"x": 1, "y": 2}]).mark_point().encode(x="x:Q", y="y:Q")


def test_a_figure_is_a_picture_of_its_kind(tmp_path: Path) -> None:
    save_figure(CHART, tmp_path / "chart.svg")
    assert ET.parse(tmp_path / "chart.svg").getroot().tag.endswith("svg")  # noqa: S314 - our own
    save_figure(CHART, tmp_path / "chart.png")
    assert (tmp_path / "chart.png").read_bytes().startswith(b"\x89PNG\r\n")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_where_no_figure_can_be_written_an_error_names_the_place(
    tmp_path: Path, suffix: str
) -> None:
    """A folder is no file, whoever writes; and one that lacks can be told beforehand."""
    (tmp_path / f"chart{suffix}").mkdir()
    with pytest.raises(OutputError, match=rf"cannot write .*chart\{suffix}"):
        save_figure(CHART, tmp_path / f"chart{suffix}")
    with pytest.raises(OutputError, match="no folder"):
        check_figure(tmp_path / "nowhere" / f"chart{suffix}")
    with pytest.raises(OutputError, match="write a name that ends in"):
        check_figure(tmp_path / f"chart{suffix}x")


def test_the_script_of_charts_is_bundled_once_and_only_read_from_an_own_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundled = list[str]()

    def bundle(snippet: str) -> str:
        bundled.append(snippet)
        return f"{snippet}\r\n// {len(bundled)}"

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(vl_convert, "javascript_bundle", bundle)
    read = vega_bundle.__wrapped__
    first = read()
    assert "vegaEmbed" in first
    assert read() == first
    assert len(bundled) == 1
    (tmp_path / "contactlab").chmod(0o777)
    assert read() != first
    (tmp_path / "contactlab").chmod(0o700)
    monkeypatch.setattr(charts, "version", lambda _name: "0.0.0")
    assert read() != first


def test_a_page_keeps_the_colors_that_a_scale_mixes() -> None:
    assert charts.with_page_colours({"range": DIVERGING_COLORS}) == {"range": DIVERGING_COLORS}
