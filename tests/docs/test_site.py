"""The site holds every page of docs, and builds without a link to nowhere."""

import subprocess
import sys
from pathlib import Path

import pytest

from contactlab.measure import LABELS, METRICS

ROOT = Path(__file__).parents[2]

build = pytest.importorskip("docs.site.build", reason="the group docs is not installed")


def test_each_page_has_its_place() -> None:
    placed = [f"{name}.md" for names in build.read_index().values() for name in names]
    folder = ROOT / "docs"
    pages = {page.relative_to(folder).as_posix() for page in folder.rglob("*.md")}
    assert sorted(placed) == sorted(pages - {"README.md", "skills/contactlab/SKILL.md"})


@pytest.mark.night
def test_the_site_builds_and_names_every_command_label_and_case(tmp_path: Path) -> None:
    asked = [sys.executable, "-m", "docs.site.build", "--target", str(tmp_path)]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr

    def page(name: str) -> str:
        return (tmp_path / "html" / name / "index.html").read_text(encoding="utf-8")

    commands = page("reference/commands")
    assert all(f'<span class="pre">{name}</span>' in commands for name in ("sweep", "tune"))
    assert all(name in page("reference/labels") for name in LABELS)
    assert all(name in page("reference/metrics") for name in METRICS)
    assert "contactlab.sweep" in page("reference/functions")
    cases = [case.stem for case in (ROOT / "sweeps/stability").glob("*.yaml")]
    assert all(case in page("gallery") for case in cases)
