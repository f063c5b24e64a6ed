"""Build the site: `python -m docs.site.build [--films]`, which `make site` calls.

Pages are the README, those that docs/README.md lists, and those that `docs.site.reference`,
`docs.site.gallery` and `docs.site.atlas` write.
A link to a file of the repository that is no page becomes a download.
"""

import argparse
import re
import shutil
import sys
from pathlib import Path

from docs.site import atlas, gallery, reference
from sphinx.cmd.build import build_main

ROOT = Path(__file__).resolve().parents[2]
_LINK = re.compile(r"\]\(([^)#:\s]+)(#[^)\s]*)?\)")


def build(target: Path, *, films: bool) -> None:
    """Build the site in a folder, anew; films of the gallery take minutes.

    Raises a RuntimeError if Sphinx finds anything wrong, such as a link to nowhere.
    """
    source = target / "source"
    shutil.rmtree(target, ignore_errors=True)
    (source / "_static").mkdir(parents=True)
    for file in ("conf.py", "site.css", "favicon.svg"):
        place = source if file == "conf.py" else source / "_static"
        shutil.copy(ROOT / "docs/site" / file, place / file)
    for page, name in _pages().items():
        (source / name).parent.mkdir(exist_ok=True)
        (source / f"{name}.md").write_text(_linked(page, source), encoding="utf-8")
    written = reference.write(source / "reference")
    shown = gallery.write(source, films=films)
    robots = atlas.write(source)
    sections = read_index()
    sections["Reference"] += written
    _write_contents(source / "index.md", {**sections, "Gallery": shown, "Atlas": robots})
    code = build_main(
        ["-q", "-W", "--keep-going", "-b", "dirhtml", str(source), str(target / "html")]
    )
    if code:
        raise RuntimeError(f"the site has mistakes, which stand above; its pages are in {source}")


def read_index() -> dict[str, tuple[str, ...]]:
    """Return the pages of each section of docs/README.md, by their names from docs."""
    _, *sections = re.split(
        r"^## ", (ROOT / "docs/README.md").read_text("utf-8"), flags=re.MULTILINE
    )
    return {
        section.partition("\n")[0]: tuple(
            name.removesuffix(".md") for name, _ in _LINK.findall(section)
        )
        for section in sections
    }


def _pages() -> dict[Path, str]:
    """Return the repository's files that are pages, with their names in the site."""
    pages = {ROOT / "README.md": "index", ROOT / "docs/README.md": "documents"}
    pages |= {ROOT / f"docs/{name}.md": name for names in read_index().values() for name in names}
    return pages | {ROOT / "CONTRIBUTING.md": "contributing", ROOT / "CHANGELOG.md": "changelog"}


def _linked(page: Path, source: Path) -> str:
    """Return a page's text with its links as they are in the site."""
    pages = _pages()

    def replace(link: re.Match[str]) -> str:
        target = (page.parent / link[1]).resolve()
        if target in pages:
            return f"](/{pages[target]}.md{link[2] or ''})"
        if not target.exists():
            raise RuntimeError(f"{page.relative_to(ROOT)} links to {link[1]}, which is not there")
        if target.is_dir():
            return "](/index.md)"
        copy = Path("files") / target.relative_to(ROOT)
        if copy.suffix == ".md":  # else Sphinx takes it for a page
            copy = copy.with_name(f"{copy.name}.txt")
        (source / copy).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(target, source / copy)
        return f"](/{copy})"

    return _LINK.sub(replace, page.read_text(encoding="utf-8"))


def _write_contents(index: Path, sections: dict[str, tuple[str, ...]]) -> None:
    sections = {**sections, "Project": ("documents", "contributing", "changelog")}
    with index.open("a", encoding="utf-8") as file:
        for title, names in sections.items():
            lines = "\n".join(names)
            file.write(f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{lines}\n```\n")


def main() -> None:
    """Build the site in build/site."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--films", action="store_true", help="run the hard cases of the gallery")
    parser.add_argument("--target", type=Path, default=ROOT / "build/site")
    asked = parser.parse_args()
    try:
        build(asked.target, films=asked.films)
    except RuntimeError as error:
        sys.exit(str(error))
    print(asked.target / "html/index.html")  # noqa: T201


if __name__ == "__main__":
    main()
