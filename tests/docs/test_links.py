"""Links between pages lead to files and headings that exist."""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [*ROOT.glob("*.md"), *(ROOT / "changelog.d").glob("*.md"), *(ROOT / "docs").rglob("*.md")]
LINK = re.compile(r"\]\(([^)\s#:]*)(?:#([^)\s:]+))?\)")
FENCE = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)


@cache
def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ +(.+)$", FENCE.sub("", page.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


def broken_links(page: Path) -> list[str]:
    # Fragments are joined into the changelog at the root.
    folder = ROOT if page.parent.name == "changelog.d" else page.parent
    broken = []
    for name, anchor in LINK.findall(FENCE.sub("", page.read_text("utf-8"))):
        target = folder / name if name else page
        known = not anchor or (target.suffix == ".md" and anchor in anchors(target))
        if not (target.exists() and known):
            broken.append(f"{name}#{anchor}")
    return broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_link_of_a_page_leads_somewhere(page: Path) -> None:
    assert broken_links(page) == []


def test_a_link_to_nowhere_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.md").write_text(
        "# One `b`-c\n\n[a](b.md) [b](#one-b-c) [c](a.md#two) `[d](e)`\n"
    )
    assert broken_links(tmp_path / "a.md") == ["b.md#", "a.md#two", "e#"]
