"""Contact settings in units of the world: the laws backwards, and what a run shows of them."""

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
from tests.run.test_task import SQUEEZE

from contactlab.command_line.declaration import find_command
from contactlab.commands.examine import examine
from contactlab.commands.explain import explain
from contactlab.contact.contact_laws import damping_ratio, restitution_from_damping
from contactlab.errors import ContactlabError, ExpectationError, SceneError, SweepFileError
from contactlab.rendering.text import render_text
from contactlab.reporting.examination import contact_facts, grouped_contacts
from contactlab.scene.contact_at_rest import ContactAtRest
from contactlab.studies.examine.contact_values import measure_contacts, read_values
from contactlab.studies.examine.resting_contacts import RestingPair
from contactlab.tasks.session import Session

BALL = """<mujoco><option cone="{cone}" impratio="{impratio}"/><worldbody>
<geom name="floor" type="plane" size="1 1 .1" friction="{friction}"/>
<body name="ball" pos="0 0 .0499"><freejoint/>
<geom name="ball" size=".05" mass="2" condim="{condim}" friction="{friction}"/></body>
</worldbody></mujoco>"""


def shown(path: Path, *settings: str) -> str:
    """Return the text of the section of contacts, in one line."""
    report = examine(path, section=["contacts"], set=settings, output=path.parent / "out")
    return " ".join(render_text(report.describe()).split())


def resting(softness: float = 1.0) -> RestingPair:
    solimp = (0.9, 0.95, 0.001, 0.5, 2.0)
    law = ContactAtRest("a-b", (0.02, 1.0), solimp, 0.5, softness, 0.05)
    return RestingPair(law, law.name, None, "held", 1.0, 20.0)


@pytest.mark.parametrize("depth", [1e-6, 3e-4, 2e-3])
@pytest.mark.parametrize("softness", [1.0, 0.3])
def test_a_depth_is_solved_for_as_the_law_has_it(depth: float, softness: float) -> None:
    """The law of rest, at the solref that it was solved for, gives the depth back."""
    pair = resting(softness=softness)
    solref = pair.solve_softness({"depth_at_rest": depth, "restitution": 0.4})
    there = replace(pair, law=replace(pair.law, solref=solref))
    assert there.expected_depth == pytest.approx(depth, rel=1e-9)
    assert float(restitution_from_damping(damping_ratio(solref))) == pytest.approx(0.4, rel=1e-9)
    assert pair.solve_softness({"stiffness": 20 / depth, "restitution": 0.4}) == pytest.approx(
        solref
    )


def test_a_run_that_stops_in_its_first_steps_has_no_resting_contacts(tmp_path: Path) -> None:
    model = tmp_path / "reed.xml"
    joint = '<joint name="root" axis="0 1 0" stiffness="1e6" springref="40"/>'
    model.write_text(
        f"""<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
        <body pos="0 0 .3">{joint}<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01"/></body>
        </worldbody></mujoco>"""
    )
    report = examine(model, section=["contacts"], output=tmp_path / "out")
    assert [(contact.load, contact.depth) for contact in report.contacts] == [(0, 0)]


@pytest.mark.long
@pytest.mark.parametrize(
    ("cone", "condim", "friction", "impratio"),
    [
        ("elliptic", 3, 0.5, 1),
        ("pyramidal", 1, 0.5, 1),
        ("pyramidal", 3, 0.5, 1),
        ("pyramidal", 3, 1.3, 4),
        ("pyramidal", 4, 0.8, 1),
    ],
)
def test_a_run_is_as_deep_as_the_law_says(
    tmp_path: Path, cone: str, condim: int, friction: float, impratio: float
) -> None:
    """Of every cone; the impedance at the depth that a pyramid leaves is the law's within 2 %."""
    model = tmp_path / "ball.xml"
    text = BALL.format(cone=cone, condim=condim, friction=friction, impratio=impratio)
    model.write_text(text)
    values = {"depth_at_rest": "2e-4"}
    _, (contact,), missed = measure_contacts(str(model), [], values, Session(tmp_path / "out"))
    assert not missed
    assert contact.depth == pytest.approx(2e-4, rel=0.02)
    assert contact.load == pytest.approx(2 * 9.81, rel=1e-4)
    assert "19.62 N on one contact" in dict(contact_facts(contact))["depth_at_rest"]


def test_force_begins_at_the_margin(tmp_path: Path) -> None:
    """A ball that its margin keeps 3 mm away is as deep in it as the law says."""
    text = BALL.format(cone="elliptic", condim=3, friction=1, impratio=1)
    model = tmp_path / "ball.xml"
    model.write_text(text.replace('name="ball" size', 'margin="0.003" name="ball" size'))
    values = {"depth_at_rest": ".2 mm"}
    assert not measure_contacts(str(model), [], values, Session(tmp_path / "out"))[2]


def test_what_does_not_rest_has_no_depth(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no pair rests at the end of the first phase"):
        measure_contacts("ball_drop", [], {"depth_at_rest": "1e-4"}, Session(tmp_path))


@pytest.mark.long
def test_rest_is_that_of_the_first_phase(tmp_path: Path) -> None:
    """Pushes of its weight come later; a box lies on four corners, each with mg / 4."""
    floor = '<geom name="floor" type="plane" size="1 1 .1"/>'
    box = '<geom name="box" type="box" size=".1 .1 .05" mass="2"/>'
    (tmp_path / "box.xml").write_text(
        f'<mujoco><worldbody>{floor}<body pos="0 0 .05"><freejoint/>{box}</body></worldbody>'
        "</mujoco>"
    )
    text = shown(tmp_path / "box.xml")
    assert "1 s at rest, then 2 s of pushes" in text
    assert f"{2 * 9.81 / 4:.4g} N on each of 4 contacts" in text


def test_contacts_that_are_alike_are_said_once() -> None:
    """Each name stands once, over the lines that it would have alone."""
    soft = resting().contact(2e-3)
    contacts = [
        soft.model_copy(update={"name": name, "load": load})
        for name, load in (("a-b", 20.0), ("a-c", 10.0), ("b-c", 20.0), ("a-long: name-d", 20.0))
    ]
    said = grouped_contacts(contacts)
    assert [*said] == ["a-b, b-c, a-long: name-d", "a-c"]
    for contact in contacts:
        (facts,) = (facts for names, facts in said.items() if contact.name in names.split(", "))
        assert facts == contact_facts(contact)


@pytest.mark.long
def test_a_squeeze_is_explained_with_its_forces(tmp_path: Path) -> None:
    """What motors press a box with is, to the four digits that are printed, plain MuJoCo's."""
    path = tmp_path / "grip.xml"
    path.write_text(SQUEEZE)
    model = mujoco.MjModel.from_xml_path(str(path))
    data, steps = mujoco.MjData(model), round(2 / model.opt.timestep)
    mujoco.mj_resetDataKeyframe(model, data, model.key("grip").id)
    box = model.geom("box").id
    loads, counts = {"left": 0.0, "right": 0.0}, {"left": 0.0, "right": 0.0}
    for step in range(steps):
        mujoco.mj_step(model, data)
        if step < steps - steps // 5:
            continue
        for name in loads:
            finger = model.geom(name).id
            own = [contact for contact in data.contact if {*contact.geom} == {finger, box}]
            force = sum(data.efc_force[contact.efc_address] for contact in own)
            loads[name] += force / len(own) / (steps // 5)
            counts[name] += len(own) / (steps // 5)
    text = shown(path)
    for name, load in loads.items():
        assert load * counts[name] == pytest.approx(8, rel=0.01), "what the motor presses with"
        assert f"{load:.4g} N on each of {counts[name]:.3g} contacts" in text


def test_too_long_a_step_is_told(tmp_path: Path) -> None:
    """A stiffness that the timestep does not resolve is not shown, and said so."""
    (tmp_path / "ball.xml").write_text(
        BALL.format(cone="elliptic", condim=3, friction=1, impratio=1)
    )
    settings = ["stiffness=1e9 N/m", "refsafe=false"]
    found = examine(tmp_path / "ball.xml", section=["contacts"], set=settings, output=tmp_path)
    assert "timestep       at most " in render_text(found.describe())
    failure = find_command(examine).failure(found, {})
    assert isinstance(failure, ExpectationError)
    assert "is too long for these values" in str(failure)


@pytest.mark.parametrize(
    ("text", "value"), [(".1 mm", 1e-4), ("0.1mm", 1e-4), ("1e-4", 1e-4), ("2 cm", 0.02)]
)
def test_words_are_read_in_their_units(text: str, value: float) -> None:
    assert read_values({"depth_at_rest": text}) == {"depth_at_rest": pytest.approx(value)}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"stiffness": "2e4 N"}, "stiffness=2e4 N: write a number above 0 in N/m"),
        ({"stiffness": "-3"}, "above 0 in N/m"),
        ({"depth_at_rest": "nan"}, "above 0 in m"),
        ({"restitution": "1.2"}, "above 0, at most 1"),
        ({"stiffness": "1e3 N/m", "depth_at_rest": "1 mm"}, "set the same value"),
    ],
)
def test_what_is_no_amount_is_refused(words: dict[str, str], message: str) -> None:
    with pytest.raises(SweepFileError, match=message):
        read_values(words)


def test_a_depth_beyond_the_geom_is_refused() -> None:
    with pytest.raises(SceneError, match="60 mm is deeper than the smaller geom"):
        resting().solve_softness({"depth_at_rest": 0.06})


@pytest.mark.parametrize("words", [["nothing"], ["solref=0.005 1"], ["box_slide"]])
def test_what_is_not_known_is_refused_in_one_line(words: list[str]) -> None:
    with pytest.raises(ContactlabError):
        explain(words)


def test_values_of_contacts_need_their_section(tmp_path: Path) -> None:
    with pytest.raises(SweepFileError, match=r"restitution=\.\.\. needs --section contacts"):
        examine("ball_drop", set=["restitution=.4"], output=tmp_path)
