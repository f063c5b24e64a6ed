"""The atlas in the repository: its records, what compares them, and their pages."""

from pathlib import Path
from typing import Literal

import pytest
from bench.atlas.__main__ import compare
from bench.atlas.comparing import differences
from bench.atlas.entry import (
    Confirmation,
    Entry,
    FixedModel,
    Gripped,
    Tuned,
    entries,
    read_all,
    record_of,
    releases,
)
from bench.atlas.views import contradictions
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


def test_what_a_record_tells_of_its_files_is_by_their_wheel() -> None:
    for entry in KNOWN:
        facts = entry.examination.facts if entry.examination else ()
        places = [fact.place for fact in facts if fact.kind == "file"]
        assert all(place.startswith(f"{entry.wheel}/") for place in places), entry.name


def test_each_record_says_why_there_is_no_verdict_or_has_one() -> None:
    for entry in KNOWN:
        assert bool(entry.refused) != bool(entry.examination), entry.name


def test_no_part_of_an_examination_contradicts_another() -> None:
    reports = [entry.examination for entry in JUDGED if entry.examination]
    found = {report.model: [*contradictions(report)] for report in reports}
    assert not {name: said for name, said in found.items() if said}


def test_what_is_planted_into_a_record_is_told() -> None:
    (report, *_) = (entry.examination for entry in JUDGED if entry.passed)
    assert report
    assert report.budget
    lies = {"headline": f"inaccurate: {report.headline}", "labels": ()}
    budget = report.budget.model_copy(update={"verdict": "inaccurate"})
    said = [*contradictions(report.model_copy(update={**lies, "budget": budget}))]
    assert [" ".join(each.split()[:2]) for each in said] == ["the numerics", "the verdict"]


def _said(before: Entry, after: Entry | None) -> list[str]:
    records = {"one.json": after} if after else {}
    return [str(each) for each in differences({"one.json": before}, records)]


def test_what_changed_is_told_with_what_else_changed() -> None:
    old = JUDGED[0]
    new = old.model_copy(update={"examination": None, "judge": "0", "refused": "no answer"})
    change = f"{old.name}: {old.word} -> refused"
    assert _said(old, new) == [f"{change} (the judge's code)"]
    newer = new.model_copy(update={"judge": old.judge, "version": "9", "digest": "0"})
    assert _said(old, newer) == [f"{change} ({old.wheel} {old.version} -> 9)"]
    assert _said(old, newer.model_copy(update={"version": old.version})) == [f"{change} (the file)"]
    assert not _said(old, old.model_copy(update={"judge": "0"}))


def test_a_verdict_whose_record_is_gone_is_told_and_a_refusal_is_not() -> None:
    assert _said(JUDGED[0], None) == [
        f"{JUDGED[0].name}: {JUDGED[0].word} -> no record (the record is gone)"
    ]
    assert not _said(JUDGED[0].model_copy(update={"examination": None}), None)


def test_records_are_known_by_their_place_and_those_of_releases_with_them(tmp_path: Path) -> None:
    JUDGED[0].save(tmp_path)
    for release in ("3.9.0", "3.13.0"):
        JUDGED[0].save(tmp_path / "releases" / release)
    (name,) = (file.name for file in tmp_path.glob("*.json"))
    places = (name, f"releases/3.13.0/{name}", f"releases/3.9.0/{name}")
    assert read_all(tmp_path) == dict.fromkeys(places, JUDGED[0])
    assert [place.name for place in releases(tmp_path)] == ["3.13.0", "3.9.0"]
    assert list(entries(tmp_path)) == [JUDGED[0]]


@pytest.mark.parametrize("place", ["newest section", "fragment", "older section", "readme"])
def test_a_changed_verdict_has_to_be_named_in_a_fragment_or_the_newest_section(
    place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = JUDGED[0]
    before = tmp_path / "before"
    before.mkdir()
    old = entry.model_copy(update={"examination": None, "refused": "no answer"})
    record_of(entry.family[0], before).write_text(old.model_dump_json())
    newest, older = (
        entry.name if place == f"{each} section" else "" for each in ("newest", "older")
    )
    changelog = tmp_path / "CHANGELOG.md"
    changelog.write_text(f"# Changelog\n\n## 2\n\n{newest}\n\n## 1\n\n{older}\n")
    fragments = {"fragment": "hopper.changed.md", "readme": "README.md"}
    (tmp_path / "changelog.d").mkdir()
    (tmp_path / "changelog.d" / fragments.get(place, "other.added.md")).write_text(
        f"`{entry.name}` is judged.\n" if place in fragments else "Nothing.\n"
    )
    assert compare(before, changelog) == (place in {"newest section", "fragment"})
    assert entry.name in capsys.readouterr().out


def test_a_mended_robot_has_a_script_that_installs_its_wheel() -> None:
    kept = FixedModel(name="RK4", changes_model=False, passed=False, headline="no")
    working = FixedModel(
        name="half", changes_model=True, passed=True, headline="yes", patch="-a\n+b\n"
    )
    shown = Confirmation(
        command="python bench/atlas/confirm.py a/b.xml --of run", holds=True, shown="9 %"
    )
    entry = JUDGED[0].model_copy(
        update={
            "fixed": (kept, working.model_copy(update={"shown": False})),
            "confirmation": shown,
        }
    )
    assert entry.working_fix
    assert entry.working_fix.name == "half"
    assert atlas.fix_text(entry) == "half (changes the model)"
    text = atlas.script(entry).splitlines()
    assert text[-1] == "python confirm.py a/b.xml --of run"
    assert text[-2].endswith(f"--target {entry.wheel} {entry.wheel}=={entry.version}")


@pytest.mark.parametrize(
    ("not_tried", "told"),
    [(("condim 1",), "none found: it may be intended"), (("RK4",), "not found in the time it had")],
)
def test_softness_without_a_change_may_be_meant_and_rows_are_no_changes(
    not_tried: tuple[str, ...], told: str
) -> None:
    soft = next(entry for entry in JUDGED if entry.word == "depends")
    assert soft.examination
    report = soft.examination.model_copy(update={"not_tried": not_tried})
    assert atlas.fix_text(soft.model_copy(update={"examination": report, "fixed": ()})) == told


def test_pages_name_the_command_the_licence_and_the_files(tmp_path: Path) -> None:
    assert atlas.write(tmp_path) == ("atlas",)
    table = (tmp_path / "atlas.md").read_text()
    for entry in JUDGED:
        name = atlas.slug(entry)
        assert f'href="{name}/"' in table
        page = (tmp_path / "atlas" / f"{name}.md").read_text()
        assert f"contactlab {entry.name}" in page
        assert f"{entry.wheel}=={entry.version}" in page
        assert entry.licence in page
        static = tmp_path / "_static/atlas"
        assert Entry.model_validate_json((static / f"{name}.json").read_bytes()) == entry
        assert entry.word in (static / f"{name}.svg").read_text()


@pytest.mark.parametrize(
    ("word", "speed", "cell"),
    [("creeps", 1.256e-3, "creeps 1.26 mm/s"), ("creeps", None, "creeps"), ("holds", 0, "holds")],
)
def test_a_hand_has_a_cell_and_a_part_of_its_page(
    word: Literal["holds", "creeps"],
    speed: float | None,
    cell: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said = f"{word}: a box of 30x40x40 mm goes <away>; held by noslip 3"
    bare, grip = JUDGED[0], Gripped(word=word, sentence=said, speed=speed)
    tuned = Tuned(sentence="", settings={}, ratio=0.75, seconds=1)  # by what is left out
    known = [bare.model_copy(update={"grip": grip, "tuned": tuned}), JUDGED[1]]
    monkeypatch.setattr(atlas, "entries", lambda _="": iter(known))
    atlas.write(tmp_path)
    index = (tmp_path / "atlas.md").read_text()
    assert f">{cell}<small>" in index
    assert '<td data-order="0.25">25 %</td>' in index
    assert f"| {cell} | noslip 3 | {bare.word} |" in index
    first, second = ((tmp_path / f"atlas/{atlas.slug(each)}.md").read_text() for each in known)
    assert f"{word}: a box of 30x40x40 mm goes \\<away\\>" in first
    assert f"contactlab grip {bare.name}" in first
    assert "## Its grip" not in second
