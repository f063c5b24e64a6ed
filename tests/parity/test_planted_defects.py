"""Each planted defect is found, at the stage of a step in which it acts first."""

import json
from collections.abc import Callable
from xml.etree import ElementTree as ET

import pytest
from jsonschema import Draft202012Validator

from contactlab.errors import SweepFileError
from contactlab.resources import SCHEMAS
from contactlab.studies.parity.parity_report import ParityReport
from contactlab.studies.parity.report_sections import report_of
from contactlab.writers import as_annotations, as_junit, as_markdown, as_text

Parity = Callable[..., ParityReport]
# It slides from the start, so that friction acts in full.
INCLINE = """
version: 1
scene: incline
duration: 0.2
axes: {tilt: [35.0], timestep: [0.002]}
"""
# The pads' servos are told where to go as time goes on.
GRASP = """
version: 1
scene: grasp_mug
duration: 0.3
axes: {timestep: [0.002], shape: [2]}
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("sweep", "defect", "stage", "quantity"),
    [
        (INCLINE, "friction", "contacts", "friction of floor - box"),
        (INCLINE, "contact", "contacts", "count of floor - box"),
        (INCLINE, "buffer", "buffers", "contactfull"),
        pytest.param(GRASP, "gravity", "forces", "qfrc_bias", marks=pytest.mark.night),
        pytest.param(GRASP, "late", "whole run", "qpos", marks=pytest.mark.night),
    ],
    ids=["friction", "contact", "buffer", "gravity", "late"],
)
def test_a_defect_is_found_at_its_stage(
    parity: Parity, sweep: str, defect: str, stage: str, quantity: str
) -> None:
    report = parity(sweep, defect)
    (run,) = report.runs
    assert run.verdict == "different"
    assert run.first_divergence is not None
    assert (run.first_divergence.stage, run.first_divergence.quantity.startswith(quantity)) == (
        stage,
        True,
    ), run.first_divergence
    assert report.exit_code == 1


@pytest.mark.long
@pytest.mark.parametrize(
    "sweep", [INCLINE, pytest.param(GRASP, marks=pytest.mark.night)], ids=["incline", "grasp"]
)
def test_without_a_defect_every_number_is_the_same(parity: Parity, sweep: str) -> None:
    report = parity(sweep)
    (run,) = report.runs
    assert (run.verdict, run.position, run.repeat_difference, run.step) == ("same", 0.0, 0.0, 0.0)
    assert report.exit_code == 0
    assert {each.outcome for each in report.findings} == {"passed"}


@pytest.mark.long
def test_what_is_set_for_the_engine_alone_is_found_as_if_it_were_planted(parity: Parity) -> None:
    report = parity(INCLINE, "", "friction.slide=0.525")
    (run,) = report.runs
    assert run.first_divergence is not None
    assert (
        run.first_divergence.stage,
        run.first_divergence.mujoco,
        run.first_divergence.engine,
    ) == ("contacts", 0.5, 0.525)
    # g (sin 35 - .525 cos 35) / g (sin 35 - .5 cos 35) is 12 % less: who is off is the engine.
    assert report.closed_form is not None
    assert report.closed_form.inaccurate == "engine"


@pytest.mark.parametrize(
    ("change", "word"), [("friction.slide=0.5,0.6", "one value"), ("timestep=0.001", "same bodies")]
)
def test_what_cannot_be_set_for_the_engine_alone_is_refused(
    parity: Parity, change: str, word: str
) -> None:
    with pytest.raises(SweepFileError, match=word):
        parity(INCLINE, "", change)


@pytest.mark.long
def test_a_refused_run_is_neither_good_nor_bad(parity: Parity) -> None:
    both = INCLINE.replace("axes: {", "axes: {solver: [Newton, PGS], ")
    report = parity(both)
    assert [each.verdict for each in report.runs] == ["same", "refused"]
    assert "PGS" in report.runs[1].reason
    assert [each.outcome for each in report.findings][:2] == ["warned", "passed"]
    alone = parity(INCLINE.replace("axes: {", "axes: {solver: [PGS], "))
    assert (alone.exit_code, alone.verdicts) == (3, {"refused": 1})


@pytest.mark.long
def test_an_engine_that_fails_is_not_compared(parity: Parity) -> None:
    report = parity(INCLINE, "crash")
    assert (report.exit_code, report.verdicts) == (3, {"failed": 1})
    assert "planted" in report.runs[0].reason


@pytest.mark.long
def test_a_policy_may_allow_more_and_waive_a_difference(parity: Parity) -> None:
    waiver = {"check": "stages agree", "max": 1, "reason": "another friction on purpose"}
    rules = {name: {"rel": 1.0} for name in ("success", "penetration_mean", "energy")}
    report = parity(INCLINE, "friction", waive=[waiver], metrics=rules)
    assert (report.exit_code, report.verdicts) == (0, {"different": 1})


@pytest.mark.long
def test_every_format_tells_the_same_divergence(parity: Parity) -> None:
    report = parity(INCLINE, "friction")
    told = "friction of floor - box"
    assert told in as_text(report_of(report))
    assert told in as_markdown(report_of(report)).replace("\\", "")
    assert json.loads(report.model_dump_json())["runs"][0]["first_divergence"]["quantity"] == told
    suite = ET.fromstring(as_junit(report_of(report))).find("testsuite")  # noqa: S314 - our own
    assert suite is not None
    failures = [case.get("name") for case in suite if case.find("failure") is not None]
    assert "stages agree" in failures
    lines = as_annotations(report_of(report)).splitlines()
    assert {line.split("::")[1] for line in lines} == {
        f"error title=contactlab parity panel --against {report.engine}"
    }
    assert any(told in line for line in lines)


def test_the_published_schema_is_that_of_the_report() -> None:
    published = json.loads((SCHEMAS / "parity.schema.json").read_text())
    dialect = published.pop("$schema")
    assert dialect == Draft202012Validator.META_SCHEMA["$id"]
    assert published == ParityReport.model_json_schema(mode="serialization")
