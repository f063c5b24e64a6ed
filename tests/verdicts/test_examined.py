"""What an examination says of the corpus is counted by what is true of it."""

from pathlib import Path

import pytest
from tests.verdicts.__main__ import examined_totals
from tests.verdicts.corpus import Case, read_part
from tests.verdicts.examined import Asked, Examined, examine
from tests.verdicts.test_corpus import CASE, FALL, write

SERVO = """<mujoco><option timestep="<<h>>"/><worldbody><body name="vane"><joint name="shaft"/>
<geom type="box" size=".1 .1 .01" mass="1"/></body></worldbody><actuator>
<velocity name="drive" joint="shaft" kv="5" forcerange="-3 3"/></actuator>
<keyframe><key ctrl=".5"/></keyframe></mujoco>"""


def case_of(folder: Path, text: str, **told: object) -> Case:
    folder.mkdir()
    (folder / "fall.xml").write_text(text, encoding="utf-8")
    write(folder, {**CASE, **told})
    return read_part(folder).cases[0]


@pytest.mark.parametrize(
    ("named", "where", "meant"),
    [
        (("joint shaft",), ["shaft"], True),
        (("contact world - vane",), ["vane"], True),
        (("vanes",), ["vane"], False),
        ((), ["vane"], False),
    ],
)
def test_names_are_words(named: tuple[str, ...], where: list[str], meant: bool) -> None:
    assert Examined("", named=named).names(where) == meant


def test_totals_count_by_nature(tmp_path: Path) -> None:
    numerical = case_of(tmp_path / "a", FALL, nature="numerical", where=["ball"])
    soft = case_of(tmp_path / "b", FALL, nature="model", where=["ball"])
    bad = Examined("", "inaccurate", ("chatter",), named=("ball",), change="RK4", mended=0.2)
    unmended = Examined(
        "", "depends", rows={"noslip": 0.3}, named=("floor",), change="Euler", mended=3
    )
    totals = examined_totals(
        [
            (Asked("a", numerical, healthy=False), bad),
            (Asked("a", numerical, healthy=False), Examined("", "ok")),
            (Asked("b", soft, healthy=False), unmended),
            (Asked("a", numerical, healthy=True), Examined("", "ok")),
            (Asked("b", soft, healthy=True), Examined("", "ok", ("creep",))),
        ]
    )
    assert list(totals.values()) == [
        *["1 of 2"] * 3,
        *["1 of 1", "0 of 1", "1 of 1"],
        *["0 of 2", "1 of 2", "0 of 2"],
        *["1 of 2", "2 of 2", "1 of 2"],
    ]


@pytest.mark.long
def test_a_change_that_is_named_is_made_in_plain_mujoco(tmp_path: Path) -> None:
    # h kv / I = 15 at 10 ms: the speed turns round at each step, by h F / I = 9 rad/s at its limit.
    told = {
        "truth": "trembles(1, 'shaft')",
        "duration": 1.0,
        "failing": {"h": 0.01},
        "healthy": {"h": 0.0001},
    }
    case = case_of(tmp_path / "a", SERVO, **told)
    path = tmp_path / "vane.xml"
    path.write_text(case.text(healthy=False), encoding="utf-8")
    said = examine(path, case, healthy=False)
    assert said.word == "inaccurate"
    assert said.found
    assert said.names(["shaft", "vane"])
    assert said.change
    assert said.mended is not None
    assert said.mended < 1
