"""What an axis value becomes in the resolved settings and in the model."""

import pickle
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.contact_laws import (
    damping_ratio,
    restitution_from_damping,
    stiffness_damping,
)
from contactlab.mjcf import AT_REST, CONTACT, OPTIONS
from contactlab.scene.model_edits import FLAG_NAMES, non_default_flags, read_flags, write_flags
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.scene import Scene

BALL = Scene.open("ball_drop")
SLIDE = Scene.open("box_slide")
OPTION_NAMES = [
    name
    for name, each in PARAMETERS.items()
    if name == each.sets and name not in (*CONTACT, *AT_REST)
]


def solref(scene: Scene, values: dict[str, Any]) -> tuple[float, ...]:
    return tuple(scene.resolve(values, 0, None).settings["solref"])  # type: ignore[arg-type]


@given(st.floats(1e-3, 1.0))
def test_restitution_gives_its_damping_at_the_stiffness_as_written(restitution: float) -> None:
    found = solref(BALL, {"restitution": restitution})
    assert found[0] == -160000.0
    assert restitution_from_damping(damping_ratio(found)) == pytest.approx(restitution, rel=1e-9)


@given(st.floats(0.05, 1.0), st.floats(1.0, 1e6))
def test_restitution_keeps_a_stiffness_that_is_swept_beside_it(e: float, stiffness: float) -> None:
    values = {"restitution": e, "solref.stiffness": stiffness}
    found = solref(BALL, values)
    assert found == solref(BALL, dict(reversed(values.items())))
    assert found[0] == pytest.approx(-stiffness, rel=1e-15)
    assert restitution_from_damping(damping_ratio(found)) == pytest.approx(e, rel=1e-9)


def test_restitution_over_a_standard_form_keeps_its_frequency() -> None:
    # box_slide has MuJoCo's default solref, "0.02 1": K = 1 / (tc dr)^2.
    found = solref(SLIDE, {"restitution": 0.5})
    assert found[0] == pytest.approx(-2500.0, rel=1e-14)
    assert restitution_from_damping(damping_ratio(found)) == pytest.approx(0.5, rel=1e-9)


@given(st.floats(1e-4, 1.0), st.floats(0.01, 5.0))
def test_standard_parts_set_one_number_each(constant: float, ratio: float) -> None:
    assert solref(SLIDE, {"solref.timeconst": constant}) == (constant, 1.0)
    assert solref(SLIDE, {"solref.dampratio": ratio}) == (0.02, ratio)
    both = {"solref.dampratio": ratio, "solref.timeconst": constant}
    assert solref(SLIDE, both) == (constant, ratio)
    # A direct form has neither, so that MuJoCo's default stands in.
    assert solref(BALL, {"solref.timeconst": constant}) == (constant, 1.0)


@given(st.floats(1.0, 1e8), st.floats(0.0, 1e4))
def test_direct_parts_keep_the_other_number(stiffness: float, damping: float) -> None:
    k, b = (float(part) for part in stiffness_damping((0.02, 1.0)))
    assert solref(SLIDE, {"solref.stiffness": stiffness}) == pytest.approx((-stiffness, -b))
    assert solref(SLIDE, {"solref.damping": damping}) == pytest.approx((-k, -damping))


def test_what_the_engine_clamps_is_written_as_asked() -> None:
    # Refsafe raises a time constant below two steps, and the engine clips impedances; neither is
    # our business: the setting and the model say what was asked.
    values = {"timestep": 0.02, "solref.timeconst": 0.001, "solimp.dmin": 1e-9}
    run = SLIDE.resolve(values, 0, None)
    model = SLIDE.base({}).prepare(run.list_edits()).model
    assert model.geom("box").solref[0] == run.settings["solref"][0] == 0.001  # type: ignore[index]
    assert model.geom("box").solimp[0] == 1e-9


@pytest.mark.parametrize("place", range(5))
def test_solimp_parts(place: int) -> None:
    name = ("dmin", "dmax", "width", "midpoint", "power")[place]
    own, found = (
        SLIDE.resolve(values, 0, None).settings["solimp"]
        for values in ({}, {f"solimp.{name}": 1.5})
    )
    expected = list(own)  # type: ignore[call-overload]
    expected[place] = 1.5
    assert found == tuple(expected)


def test_friction_parts_stand_for_both_directions() -> None:
    values = {"friction.slide": 0.1, "friction.torsion": 0.2, "friction.roll": 0.3}
    assert SLIDE.resolve(values, 0, None).settings["friction"] == (0.1, 0.1, 0.2, 0.3, 0.3)
    whole = SLIDE.resolve({"friction": (0.1, 0.2, 0.3)}, 0, None).settings["friction"]
    assert whole == (0.1, 0.1, 0.2, 0.3, 0.3)


@pytest.mark.interface
@pytest.mark.parametrize("name", OPTION_NAMES)
def test_an_option_is_the_attribute_of_that_name(name: str) -> None:
    texts = [*PARAMETERS[name].choices] or ["1 2 3" if name == "gravity" else "3"]
    for text in texts:
        inner = f"<option {name}='{text}'/>"
        wanted = mujoco.MjModel.from_xml_string(f"<mujoco>{inner}</mujoco>")
        value = PARAMETERS[name].parse(text)
        model = SLIDE.base({}).prepare(SLIDE.resolve({name: value}, 0, None).list_edits()).model
        assert np.array_equal(getattr(model.opt, name), getattr(wanted.opt, name))


def test_gravity_as_a_magnitude_points_down() -> None:
    for value in (PARAMETERS["gravity"].parse("3.7"), PARAMETERS["gravity"].parse(3.7)):
        run = BALL.resolve({"gravity": value}, 0, None)
        assert run.settings["gravity"] == (0.0, 0.0, -3.7)
        model = BALL.base({}).prepare(run.list_edits()).model
        assert model.opt.gravity.tolist() == [0.0, 0.0, -3.7]


@pytest.mark.interface
@pytest.mark.parametrize("flag", FLAG_NAMES)
@pytest.mark.parametrize("state", [True, False])
def test_a_switch_is_the_flag_of_that_name(flag: str, state: bool) -> None:
    words = {True: "enable", False: "disable"}
    text = f"<mujoco><option><flag {flag}='{words[state]}'/></option></mujoco>"
    wanted = mujoco.MjModel.from_xml_string(text)
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    usual = read_flags(model)[flag]
    write_flags(model, {flag: state})
    write_flags(wanted, {})
    assert model.opt.disableflags == wanted.opt.disableflags
    assert model.opt.enableflags == wanted.opt.enableflags
    assert read_flags(model)[flag] is state
    assert non_default_flags({flag: state}) == ({} if state == usual else {flag: state})


def test_what_recording_needs_is_on_whatever_the_model_says(make_scene: Any) -> None:
    flags = "autoreset='enable' sensor='disable' energy='enable' fwdinv='enable'"
    scene = make_scene(
        f"<mujoco><option><flag {flags}/></option><worldbody><body><freejoint/><geom size='.1'/>"
        "</body></worldbody></mujoco>"
    )
    run = scene.resolve({}, 0, None)
    model = scene.base({}).prepare(run.list_edits()).model
    disabled, enabled = model.opt.disableflags, model.opt.enableflags
    assert disabled == mujoco.mjtDisableBit.mjDSBL_AUTORESET
    assert enabled == 0
    assert run.flags == read_flags(model)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("timestep", 0), ("timestep", -1e-3), ("timestep", "nan"), ("timestep", "fast"),
        ("timestep", True), ("timestep", float("inf")), ("iterations", 1.5), ("iterations", 0),
        ("iterations", 1e10), ("integrator", "leapfrog"), ("cone", 1), ("condim", 2), ("condim", 5),
        ("solref", (0.02, -1.0)), ("solref", (0.0, 0.0)), ("solref", "0.02"), ("solref", (1, 2, 3)),
        ("solimp", (0.9, 0.95)), ("solimp", (0.0, 0.95, 0.001)), ("solimp.dmax", 1.0),
        ("solimp", (0.9, 0.95, 0.001, 0.5, 0.5)), ("friction", 0.5), ("friction", (1, -1, 0)),
        ("friction.slide", -0.1), ("restitution", 0), ("restitution", 1.01), ("margin", -1e-3),
        ("gravity", "down"), ("gravity", (1, 2)), ("impratio", 0), ("solref.damping", -1),
    ],
)  # fmt: skip
def test_illegal_values_say_what_to_write(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match="write"):
        PARAMETERS[name].parse(value)


def test_every_axis_says_what_it_is() -> None:
    for scene in (BALL, SLIDE, Scene.open("box_stack")):
        assert len(set(scene.catalogue.names)) == len(scene.catalogue.names)
        for name in scene.catalogue.names:
            axis = scene.catalogue.find_axis(name)
            assert axis is not None
            assert axis.name == name
            assert axis.description
            assert all(scene.catalogue.find_axis(other) for other in axis.conflicts)
    assert PARAMETERS["gravity"] == BALL.catalogue.find_axis("gravity")


def test_a_model_without_contact_has_no_contact_axes(make_scene: Any) -> None:
    scene = make_scene(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    assert scene.base({}).pairs == ()
    assert scene.catalogue.find_axis("friction") is None
    assert scene.catalogue.find_axis("timestep") is not None
    assert scene.catalogue.find_axis("mass") is not None


def test_mjcf_has_a_place_for_every_parameter() -> None:
    assert {parameter.sets for parameter in PARAMETERS.values()} <= {*OPTIONS, *CONTACT, *AT_REST}


@pytest.mark.parametrize("name", ["solimp", "friction"])
def test_how_a_vector_is_split_reaches_workers(name: str) -> None:
    """Workers are sent what a sweep's axes need; what a process cannot be sent ends the sweep."""
    split = pickle.loads(pickle.dumps(PARAMETERS[name].split))  # noqa: S301 - made here
    values = (0.5, 0.1, 0.1, 0.5, 2.0)[: len(PARAMETERS[name].parts)]
    assert split(values) == dict(zip(PARAMETERS[name].parts, values, strict=True))
