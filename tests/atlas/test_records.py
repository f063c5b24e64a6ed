"""The atlas in the repository: its records, what compares them, and their pages."""

from pathlib import Path

import pytest
from atlas.__main__ import compare
from atlas.comparing import differences
from atlas.entry import Entry, entries
from docs.site import atlas

KNOWN = list(entries())
JUDGED = [entry for entry in KNOWN if entry.examination]


def test_each_family_has_one_record_and_each_robot_one_page() -> None:
    assert JUDGED
    assert len({entry.family[0] for entry in KNOWN}) == len(KNOWN)
    assert len({atlas.slug(entry) for entry in JUDGED}) == len(JUDGED)


def test_records_hold_nothing_of_the_machine_that_made_them() -> None:
    for entry in KNOWN:
        assert "/tmp/" not in entry.model_dump_json(), entry.name  # noqa: S108


def test_each_record_says_why_there_is_no_verdict_or_has_one() -> None:
    for entry in KNOWN:
        assert bool(entry.refused) != bool(entry.examination), entry.name


def test_what_changed_is_what_the_same_file_says_otherwise() -> None:
    old, *rest = JUDGED
    new = old.model_copy(update={"examination": None, "judge": "0", "refused": "no answer"})
    other = new.model_copy(update={"digest": "0"})
    assert [str(each) for each in differences([old, *rest], [new, *rest])] == [
        f"{old.name}: {old.word} -> refused (the judge's code)"
    ]
    assert not list(differences([old], [other]))


@pytest.mark.parametrize("told", [True, False])
def test_a_verdict_that_changed_has_to_be_told_in_the_changelog(
    told: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = JUDGED[0]
    before = tmp_path / "before"
    before.mkdir()
    old = entry.model_copy(update={"examination": None, "refused": "no answer"})
    (before / "one.json").write_text(old.model_dump_json())
    text = f"`{entry.name}` is judged" if told else "nothing"
    changelog = tmp_path / "CHANGELOG.md"
    changelog.write_text(f"# Changelog\n\n## 2 - unreleased\n\n{text}\n\n## 1\n\n{entry.name}\n")
    assert compare(before, changelog) == told
    assert entry.name in capsys.readouterr().out


def test_pages_name_the_command_the_licence_and_the_files(tmp_path: Path) -> None:
    assert atlas.write(tmp_path) == ("atlas",)
    table = (tmp_path / "atlas.md").read_text()
    for entry in JUDGED:
        name = atlas.slug(entry)
        assert f'href="{name}/"' in table
        page = (tmp_path / "atlas" / f"{name}.md").read_text()
        assert f"contactlab {entry.name}" in page
        assert entry.licence in page
        static = tmp_path / "_static/atlas"
        assert Entry.model_validate_json((static / f"{name}.json").read_bytes()) == entry
        assert atlas.shown_word(entry) in (static / f"{name}.svg").read_text()
