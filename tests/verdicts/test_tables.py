"""The tables say of each model what was found, missed or flagged without cause."""

import json
from pathlib import Path

import pytest
from tests.verdicts.__main__ import main, of_corpus, of_public
from tests.verdicts.corpus import Case, read_corpus
from tests.verdicts.judge import Job, Verdict


def cases(*, held_back: bool) -> list[Case]:
    """Return the cases of the open parts, or of those that are held back."""
    return [case for part in read_corpus() if part.held_back is held_back for case in part.cases]


FLAGGED, CALM = Verdict("tunneling", "because"), Verdict("stable", "No other label applies.")


@pytest.mark.parametrize(
    ("healthy", "verdict", "outcome"),
    [
        (False, FLAGGED, "found"),
        (False, CALM, "MISSED"),
        (True, FLAGGED, "FALSE ALARM"),
        (True, CALM, "sound"),
        (True, Verdict("too slow", ""), "no verdict"),
    ],
)
def test_corpus_is_compared_with_the_truth(healthy: bool, verdict: Verdict, outcome: str) -> None:
    assert of_corpus(cases(held_back=False)[0], verdict, "open", healthy=healthy).outcome == outcome


def test_flag_of_a_public_model_is_false_unless_it_was_measured() -> None:
    names = {
        "robosuite/models/assets/robots/tiago/robot.xml": "deserved",
        "nobody's": "FALSE ALARM",
    }
    for name, outcome in names.items():
        row = of_public(Job(name, Path(), 2.0, "auto"), FLAGGED)
        assert row.outcome.partition(":")[0] == outcome


@pytest.mark.long
def test_what_is_held_back_is_shown_on_request_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "verdicts.json"
    name = "a drawer"
    main(["--only", name, "--jobs", "2", "--json", str(kept)])
    rows = json.loads(kept.read_text(encoding="utf-8"))
    rows = [row for row in rows if row["part"] != "public"]
    mine = [case.name for case in cases(held_back=False) if name in case.name]
    assert [row["name"] for row in rows] == [title for title in mine for _ in range(2)]
    assert not {row["name"] for row in rows} & {case.name for case in cases(held_back=True)}
    assert mine[0] in capsys.readouterr().out
