"""The changelog has one form, and fragments join into it."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CHANGELOG = ROOT / "CHANGELOG.md"
# Of Keep a Changelog 1.1.0.
KINDS = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_the_newest_section_is_the_version_of_the_package_and_its_citation() -> None:
    text = CHANGELOG.read_text(encoding="utf-8")
    newest = re.search(r"^## (\S+) - (\S+)$", text, re.MULTILINE)
    assert newest
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = dict(re.findall(r"^(version|date-released): (\S+)$", citation, re.MULTILINE))
    assert cited == {"version": newest[1], "date-released": newest[2]}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == newest[1]


def test_fragments_are_markdown_of_a_known_kind() -> None:
    files = {path.name for path in (ROOT / "changelog.d").iterdir()}
    for name in files - {"README.md", "template.md.jinja"}:
        assert re.fullmatch(r"[\w-]+\.(added|changed|removed|fixed|security)\.md", name)


def test_every_section_is_of_a_known_kind_and_has_entries() -> None:
    sections = re.split(r"^### ", CHANGELOG.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    for section in sections:
        name, _, entries = section.partition("\n")
        assert name in KINDS
        assert re.search(r"^- [A-Z`]", entries, re.MULTILINE), name


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """Return a copy of the files that a release needs, without fragments."""
    for file in ("pyproject.toml", "CHANGELOG.md"):
        shutil.copy(ROOT / file, tmp_path)
    shutil.copytree(ROOT / "changelog.d", tmp_path / "changelog.d")
    for fragment in (tmp_path / "changelog.d").glob("*.*.md"):
        fragment.unlink()
    return tmp_path


def _build(project: Path, *options: str) -> subprocess.CompletedProcess[str]:
    pytest.importorskip("towncrier", reason="the group lint is not installed")
    command = [sys.executable, "-m", "towncrier", "build", *options]
    return subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)


def test_a_release_joins_the_fragments_into_the_newest_section(project: Path) -> None:
    before = (project / "CHANGELOG.md").read_text(encoding="utf-8")
    texts = {"one.added": "An option.", "two.added": "A command.", "three.fixed": "A crash."}
    for name, text in texts.items():
        (project / f"changelog.d/{name}.md").write_text(f"{text}\n")
    done = _build(project, "--yes", "--version", "99.0", "--date", "2027-01-02")
    assert done.returncode == 0, done.stderr
    after = (project / "CHANGELOG.md").read_text(encoding="utf-8")
    start = "<!-- towncrier release notes start -->\n\n"
    section = (
        "## 99.0 - 2027-01-02\n\n### Added\n\n- An option.\n- A command.\n\n"
        "### Fixed\n\n- A crash.\n\n"
    )
    assert after == before.replace(start, start + section)
    assert not list((project / "changelog.d").glob("*.*.md"))


@pytest.mark.parametrize("name", ["one.feature.md", "one.md"])
def test_a_fragment_with_another_name_is_an_error(project: Path, name: str) -> None:
    (project / "changelog.d" / name).write_text("Text.\n")
    done = _build(project, "--draft", "--version", "next")
    assert done.returncode == 1
    assert name in done.stderr
