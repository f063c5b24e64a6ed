"""`contactlab report` as it is called."""

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.small_films import small_films
from typer.testing import CliRunner

from contactlab.command_line.main import command_line
from contactlab.errors import ContactlabError, OutputError, SweepFileError
from contactlab.store.finished_store import Store

Swept = Callable[[str], Store]


def call(*arguments: object) -> str:
    """Run the command and return what it prints; its errors are raised."""
    with small_films():
        done = CliRunner().invoke(
            command_line(), ["report", *map(str, arguments)], catch_exceptions=False
        )
    assert done.exit_code == 0
    return done.stdout


@pytest.mark.long
def test_the_page_is_beside_its_store_with_as_many_time_series_as_asked(swept: Swept) -> None:
    store, traces = swept("hard").path, swept("hard").manifest.traces
    page = store.with_name("store.html")
    for asked, drawn in (("1", 1), ("all", traces)):
        assert call(f"{store}/", "--traces", asked) == f"{page}\n"
        assert page.read_text().startswith("<!doctype html>")
        assert page.read_text().count('"signals"') == drawn
    assert traces > 1


@pytest.mark.long
def test_figures_are_listed(swept: Swept, tmp_path: Path) -> None:
    store = swept("hard").path
    printed = call(store, "--figures", tmp_path / "new" / "figures", "--format", "svg,png").split()
    assert {Path(each).suffix for each in printed} == {".svg", ".png"}
    assert all(Path(each).is_file() for each in printed)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        (("-o", "page.pdf"), OutputError, "ends in .html"),
        (("-o", "nowhere/page.html"), OutputError, "no folder nowhere"),
        (("--traces", "some"), OutputError, "a number of runs, all or none"),
        (("--tolerance", "oracle_error"), SweepFileError, "METRIC=VALUE"),
        (("--figures", "new", "--format", "gif"), OutputError, "png, svg, pdf"),
        (("--run", "0123"), OutputError, "needs --live"),
        (("--live", "--parity", "file.json"), OutputError, "--parity does not go with --live"),
    ],
)
def test_invalid_options_are_refused(
    swept: Swept, options: tuple[str, ...], error: type[ContactlabError], message: str
) -> None:
    with pytest.raises(error, match=message):
        call(swept("hard").path, *options)
