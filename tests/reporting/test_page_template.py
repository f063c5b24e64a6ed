"""Templates of pages are compiled once, for pages of all kinds."""

from pathlib import Path

import pytest

from contactlab.page.page_template import open_templates


def test_a_kept_template_serves_pages_with_and_without_a_last_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kept form of a template calls the function of the page that it serves."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "word.html").write_text("{{ word }}")
    for change, expected in ((str.upper, "A"), (None, "a"), (str.upper, "A")):
        given = {} if change is None else {"finalize": change}
        template = open_templates(tmp_path, **given).get_template("word.html")
        assert template.render(word="a") == expected
    assert list((tmp_path / "cache").rglob("page-*.bin"))
