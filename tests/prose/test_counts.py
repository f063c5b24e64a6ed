"""A count may fall, and move with its text, but not rise."""

import subprocess
import time
from pathlib import Path

import pytest
from tests.prose.checking import run_check
from tests.prose.counts import find_rises, read_counts, total_counts, write_counts
from tests.prose.rates import count_numeric_constants, count_used_once, measure_rates
from tests.prose.texts import read_python


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Return a checkout with one finding in each of two modules, and its stored counts."""
    folder = tmp_path / "cli"
    folder.mkdir()
    (folder / "walk.py").write_text('"""Return what walks."""\n')
    (folder / "run.py").write_text('"""Return what runs."""\n')
    write_counts({"cli/walk.py": {"what": 1}, "cli/run.py": {"what": 1}}, tmp_path / "counts.txt")
    return tmp_path


def _check(checkout: Path, *arguments: str) -> int:
    return run_check(arguments, checkout, checkout / "counts.txt")


def test_a_count_that_rises_fails_and_its_sentence_is_printed(
    checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _check(checkout) == 0
    assert capsys.readouterr().out == ""
    (checkout / "cli/walk.py").write_text('"""Return what walks.\n\nPrint what fell.\n"""\n')
    assert _check(checkout) == 1
    printed = capsys.readouterr().out
    assert "cli/walk.py: what: 2 places, 1 are allowed" in printed
    assert "cli/walk.py:3: what 'what': Print what fell." in printed


def test_only_changed_lines_are_shown_where_git_knows_them(
    checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git = ["git", "-C", str(checkout), "-c", "user.name=a", "-c", "user.email=a@b"]
    for command in (["init", "-q"], ["add", "cli"], ["commit", "-qm", "Begin"]):
        subprocess.run([*git, *command], check=True)
    (checkout / "cli/walk.py").write_text('"""Return what walks."""\n\n# Print what fell.\n')
    assert _check(checkout) == 1
    printed = capsys.readouterr().out
    assert "cli/walk.py:3: what" in printed
    assert "cli/walk.py:1: what" not in printed


def test_a_new_file_may_have_no_finding(checkout: Path) -> None:
    (checkout / "cli/swim.py").write_text('"""Return what swims."""\n')
    assert _check(checkout) == 1
    assert _check(checkout, "--lower") == 1
    assert _check(checkout, "--moved") == 1


def test_counts_only_shrink(checkout: Path) -> None:
    (checkout / "cli/walk.py").write_text('"""Return the walker."""\n')
    assert _check(checkout, "--lower") == 0
    assert read_counts(checkout / "counts.txt") == {"cli/run.py": {"what": 1}}
    (checkout / "cli/walk.py").write_text('"""Return what walks."""\n')
    assert _check(checkout) == 1
    assert _check(checkout, "--lower") == 1
    assert read_counts(checkout / "counts.txt") == {"cli/run.py": {"what": 1}}


def test_a_renamed_module_keeps_its_allowance(checkout: Path) -> None:
    (checkout / "cli/walk.py").rename(checkout / "cli/stride.py")
    assert _check(checkout) == 0
    assert _check(checkout, "--lower") == 0
    assert read_counts(checkout / "counts.txt") == {
        "cli/run.py": {"what": 1},
        "cli/stride.py": {"what": 1},
    }


def test_a_module_merged_into_another_brings_its_allowance_and_no_more(checkout: Path) -> None:
    (checkout / "cli/walk.py").unlink()
    (checkout / "cli/run.py").write_text('"""Return what runs.\n\nReturn what walks."""\n')
    assert _check(checkout) == 0
    (checkout / "cli/swim.py").write_text('"""Return what swims."""\n')
    assert _check(checkout) == 1


def test_text_that_moves_between_files_needs_a_word(checkout: Path) -> None:
    (checkout / "cli/walk.py").write_text('"""Nothing."""\n')
    (checkout / "cli/run.py").write_text('"""Return what runs.\n\nReturn what walks."""\n')
    assert _check(checkout) == 1
    assert _check(checkout, "--lower") == 1
    assert _check(checkout, "--moved") == 0
    assert read_counts(checkout / "counts.txt") == {"cli/run.py": {"what": 2}}


def test_lines_of_two_branches_allow_the_larger_count(tmp_path: Path) -> None:
    path = tmp_path / "counts.txt"
    path.write_text("a.py what=2 which=1\na.py what=1 which=3\n")
    assert read_counts(path) == {"a.py": {"what": 2, "which": 3}}


def test_rules_do_not_pay_for_each_other() -> None:
    stored = {"a.py": {"what": 5}}
    assert [rise.rule for rise in find_rises({"b.py": {"which": 1}}, stored)] == ["which"]
    assert total_counts({"a": {"what": 1}, "b": {"what": 2}})["what"] == 3


def test_constants_and_functions_are_counted() -> None:
    tree = read_python(
        "A = 1\nB: float = -2.0\nC = (1, 2)\nD = 'x'\nE = True\n"
        "def _once(): ...\ndef _twice(): ...\ndef _each(): ...\n"
        "class A:\n    def _go(self): return self._go()\n"
        "def f(): return _once(), _twice(), _twice(), [_each() for _ in D]\n",
        "module",
    ).tree
    assert tree is not None
    assert count_numeric_constants(tree) == 3
    assert count_used_once(tree) == (3, 1)


def test_rates_are_per_thousand_words(checkout: Path) -> None:
    (checkout / "README.md").write_text("One two three\n")
    (checkout / "CHANGELOG.md").write_text("One two\n")
    rates = measure_rates(checkout)
    assert rates["words of prose"] == 6
    assert rates['"what" as a noun, per 1,000 words'] == pytest.approx(1000 * 2 / 6)
    assert rates["words of README.md and docs"] == 3


@pytest.mark.timed
def test_the_whole_checkout_takes_less_than_five_seconds() -> None:
    start = time.process_time()
    run_check([])
    assert time.process_time() - start < 5
