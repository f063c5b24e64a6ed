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

    def raised(value: object) -> str:
        return str(value).upper()

    for opened, expected in (
        (open_templates(tmp_path, finalize=raised), "A"),
        (open_templates(tmp_path), "a"),
        (open_templates(tmp_path, finalize=raised), "A"),
    ):
        assert opened.get_template("word.html").render(word="a") == expected
    assert list((tmp_path / "cache").rglob("page-*.bin"))
