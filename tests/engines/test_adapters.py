"""Adapters refuse what their engines cannot do, and those that are installed agree with MuJoCo."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.engines.adapted_engine import adapted_engines
from contactlab.engines.engine import PreparedRuns
from contactlab.plan.overrides import Overrides
from contactlab.resources import ADAPTERS
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.scene.run_spec import RunSpec
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.studies.parity.panel import Panel, roll_out

ENGINES = {each.name: each for each in adapted_engines()}
BALL = """
<mujoco><option {option}>{flag}</option>
  <worldbody><geom type="plane" size="1 1 .1"/>{extra}
    <body pos="0 0 .2"><freejoint/><geom size=".1"/></body>
  </worldbody>{end}
</mujoco>"""
HINGE = '<body><joint name="j" {}/><geom size=".1"/></body>'
# Four balls in a square, whose opposite sides have frictions of other products.
SQUARE = "".join(
    f'<body><freejoint/><geom size=".1" contype="{kind}" conaffinity="{mask}" priority="{rank}" '
    f'friction="{rub}"/></body>'
    for kind, mask, rank, rub in ((2, 8, 3, 0.5), (8, 4, 0, 0.9), (4, 16, 1, 0.2), (16, 2, 2, 0.3))
)
REFUSED = [
    ("warp", {"option": 'solver="PGS"'}, "PGS"),
    ("warp", {"flag": '<flag override="enable"/>'}, "override"),
    ("mjx", {"option": 'integrator="implicit"'}, "implicitfast"),
    ("mjx", {"option": 'noslip_iterations="3"'}, "noslip"),
    ("mjx", {"flag": '<flag sleep="enable"/>'}, "sleep"),
    ("newton", {"option": 'gravity="1 0 -9"'}, "tilt the scene"),
    ("newton", {"option": 'integrator="RK4"'}, "implicitfast"),
    ("newton", {"flag": '<flag contact="disable"/>'}, "flags"),
    ("newton", {"extra": '<body><joint type="ball"/><geom size=".1"/></body>'}, "ball"),
    ("newton", {"extra": '<body mocap="true"/>'}, "mocap"),
    ("drake", {"flag": '<flag contact="disable"/>'}, "hinges and slides"),
    ("drake", {"option": 'integrator="RK4"'}, "Euler"),
    ("drake", {"extra": '<body><joint type="ball"/><geom size=".1"/></body>'}, "free bodies"),
    ("drake", {"extra": '<body><freejoint/><geom size=".1"/></body>'}, "a ball is alone"),
    ("drake", {"extra": '<body><freejoint/><geom type="capsule" size=".1 .1"/></body>'}, "boxes"),
    ("drake", {"extra": '<geom type="plane" size="1 1 .1" friction=".2"/>'}, "one friction"),
    ("drake", {"extra": '<geom type="plane" size="1 1 .1" condim="4"/>'}, "sliding alone"),
    (
        "cenic",
        {"flag": '<flag contact="disable"/>', "extra": HINGE.format('stiffness="1"')},
        "springs",
    ),
    ("cenic", {"option": 'tolerance="0"'}, "above 0"),
    ("cenic", {"extra": '<body><freejoint/><geom size=".1"/></body>'}, "a ball is alone"),
    ("bullet", {"extra": '<body><joint armature="1"/><geom size=".1"/></body>'}, "armature"),
    ("bullet", {"extra": '<body mocap="true"/>'}, "mocap"),
    ("bullet", {"extra": '<geom type="ellipsoid" size=".1 .1 .2"/>'}, "convex hulls"),
    ("bullet", {"extra": '<geom size=".1" margin=".01"/>'}, "margin"),
    ("bullet", {"extra": SQUARE}, "no numbers of theirs"),
    ("bullet", {"extra": HINGE.format('range="-1 1" limited="true"')}, "limits"),
    (
        "bullet",
        {"extra": '<body><joint type="ball" stiffness="1"/><geom size=".1"/></body>'},
        "springs",
    ),
    (
        "bullet",
        {
            "extra": HINGE.format(""),
            "end": '<actuator><intvelocity joint="j" actrange="-1 1"/></actuator>',
        },
        "motors and servos",
    ),
    ("bullet", {"extra": HINGE.format('actuatorfrcrange="-1 1"')}, "not of joints"),
    ("sapien", {"extra": '<body><joint type="ball"/><geom size=".1"/></body>'}, "ball joints"),
    ("sapien", {"extra": '<geom type="plane" size="1 1 .1" condim="4"/>'}, "sliding alone"),
    ("sapien", {"extra": HINGE.format('frictionloss="1"')}, "dry friction"),
    ("sapien", {"extra": SQUARE}, "no numbers of theirs"),
    ("sapien", {"extra": HINGE.format("").replace("<geom", '<joint axis="1 0 0"/><geom')}, "one"),
    ("genesis", {"option": 'integrator="RK4"'}, "implicitfast"),
    ("genesis", {"option": 'solver="PGS"'}, "PGS"),
    ("genesis", {"option": 'cone="elliptic" noslip_iterations="3"'}, "noslip"),
    ("genesis", {"extra": '<geom type="plane" size="1 1 .1" condim="1" priority="1"/>'}, ".01"),
    (
        "genesis",
        {"extra": '<body><freejoint/><geom size=".1" priority="1" friction=".2"/></body>'},
        "no numbers of theirs",
    ),
    ("genesis", {"extra": HINGE.format('range="-1 1" limited="true" margin=".1"')}, "margin"),
    (
        "genesis",
        {"extra": HINGE.format('type="ball" range="0 1" limited="true"')},
        "limits are of hinges",
    ),
    (
        "genesis",
        {"extra": '<geom type="plane" size="1 1 .1" solref="-1000 -2000" priority="1"/>'},
        "at least two steps",
    ),
    ("pinocchio", {}, "contact"),
    ("pinocchio", {"option": 'integrator="RK4"'}, "Euler"),
    ("pinocchio", {"option": 'density="1"', "flag": '<flag contact="disable"/>'}, "medium"),
]
# Every kind of joint, off its reference and its body's origin; a motor, a servo, springs, damping.
MODELS = Path(__file__).parent / "adapted"
TREE = (MODELS / "tree.xml").read_text(encoding="utf-8")

# The same without free and ball joints, and with a body for each joint.
ARM = re.sub(
    r'<body name="flying".*?(?=<body name="arm")|<joint name="shift"[^>]*/>',
    "",
    TREE,
    flags=re.DOTALL,
)
# A free body that turns about a centre of mass beside its origin, and joints off their references.
THROWN = (MODELS / "thrown.xml").read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "differing", "word"), REFUSED)
def test_what_an_engine_cannot_do_is_refused_by_name(
    name: str, differing: dict[str, str], word: str
) -> None:
    blanks = dict.fromkeys(("option", "flag", "extra", "end"), "")
    model = mujoco.MjModel.from_xml_string(BALL.format(**blanks | differing))
    assert word in str(refusal_of(name, model))


@pytest.mark.parametrize("name", sorted(ENGINES.keys() - {"pinocchio"}))
def test_what_it_can_do_is_not(name: str) -> None:
    blanks = dict.fromkeys(("option", "flag", "extra", "end"), "")
    assert refusal_of(name, mujoco.MjModel.from_xml_string(BALL.format(**blanks))) is None


def test_a_tree_in_free_motion_is_for_all() -> None:
    assert refusal_of("pinocchio", mujoco.MjModel.from_xml_string(TREE)) is None
    assert refusal_of("drake", mujoco.MjModel.from_xml_string(ARM)) is None


@pytest.mark.parametrize("restitution", [0.135, 0.6, 0.99, 1.0])
def test_hunt_and_crossleys_damping_has_the_restitution_that_it_is_made_of(
    restitution: float,
) -> None:
    """A ball of 1 kg that meets a spring of 1e4 N/m at 1 m/s leaves with it.

    Midpoint steps of 1e-5 s, a thousandth of 1 / w, are off by 1e-6 of the speed; the parting lies
    within the last step, which changes the speed by the force there: w h = 1e-3 at most.
    """
    damping = SimpleNamespace(
        **run_path(str(ADAPTERS / "beside" / "drake_contacts.py"))
    ).dissipation(restitution)
    step, depth, speed = 1e-5, 0.0, 1.0

    def force(depth: float, speed: float) -> float:
        return -1e4 * depth * max(0.0, 1 + damping * speed)

    while depth >= 0:
        middle = speed + step / 2 * force(depth, speed)
        depth, speed = (
            depth + step * middle,
            speed + step * force(depth + step / 2 * speed, middle),
        )
    assert -speed == pytest.approx(restitution, abs=2e-3)


def refusal_of(name: str, model: mujoco.MjModel) -> str | None:
    """Return what an adapter says of a model, without its engine."""
    file = ADAPTERS / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"tried_{name}", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.refusal(model)


def installed(name: str) -> Any:
    return pytest.mark.skipif(
        not ENGINES[name].version, reason=f"contactlab parity --install {name} was not run here"
    )


def differences(folder: Path, name: str, text: str) -> list[tuple[EvidenceRecord, float]]:
    """Return MuJoCo's runs of a sweep with how far another engine's coordinates are from them."""
    request = read_request(text, "both", folder / "store", folder=folder, workers=0)
    run_sweep(request, lambda *_: None, lambda _finished: None)
    store = Store.open(folder / "store")
    runs: dict[str, dict[str, EvidenceRecord]] = {}
    for record in store.records():
        axes = {key: value for key, value in record.axes.items() if key != "engine"}
        runs.setdefault(f"{axes} {record.seed}", {})[record.engine.name] = record
    found: list[tuple[EvidenceRecord, float]] = []
    for each in runs.values():
        ours, theirs = each["mujoco"], each[name]
        assert theirs.status == "ok", theirs.status_reason
        both = store.trace(ours).qpos, store.trace(theirs).qpos
        found.append((ours, float(np.abs(both[0] - both[1]).max())))
    return found


SLIDES = """
version: 1
scene: box_slide
duration: 0.3
axes: {engine: [mujoco, NAME], timestep: [0.001, 0.002], friction.slide: [0.3, 1.0]}
"""


@pytest.mark.night
@installed("warp")
def test_worlds_of_one_launch_have_their_own_parameters(tmp_path: Path) -> None:
    found = differences(tmp_path, "warp", SLIDES.replace("NAME", "warp"))
    # Single precision resolves 6e-8 of .4 m, in each of 300 steps at most.
    assert max(far for _, far in found) < 300 * 6e-8 * 0.4
    assert len({round(ours.metrics["slip_distance"] or 0, 4) for ours, _ in found}) == 4


MANY = """
version: 1
scene: gripping_pad
sample: {method: random, n: 24, seed: 3}
axes:
  timestep: {uniform: [0.001, 0.002]}
  friction.slide: {uniform: [0.1, 1.0]}
  solref.timeconst: {uniform: [0.01, 0.03]}
  solimp.dmin: {uniform: [0.8, 0.94]}
  mass: {uniform: [0.1, 0.4]}
  squeeze: {uniform: [0.001, 0.004]}
"""


@pytest.mark.night
@installed("warp")
def test_a_world_among_many_is_that_world_alone(tmp_path: Path) -> None:
    """Not a bit of it depends on where it is, or on the worlds beside it, of other parameters."""
    (tmp_path / "many.yaml").write_text(MANY)
    panel = Panel.read(tmp_path / "many.yaml", "warp", Overrides(), (), None)
    runs = [replace(each.ours, duration=60 * each.ours.timestep) for each in panel.runs]
    engine = ENGINES["warp"].on("cpu")

    def rolled(*some: RunSpec) -> np.ndarray:
        return roll_out(engine, PreparedRuns.of(panel.scene, *some)).state[:, :, 1:].copy()

    many = rolled(*runs)
    assert (rolled(*runs[::-1])[::-1] == many).all()
    assert (np.concatenate([rolled(each) for each in runs[:4]]) == many[:4]).all()
    # They do differ, all of them, or else nothing could leak.
    assert len(np.unique(many[:, -1], axis=0)) == 24


@pytest.mark.night
@installed("mjx")
def test_double_precision_agrees_to_the_solvers_tolerance(tmp_path: Path) -> None:
    found = differences(tmp_path, "mjx", SLIDES.replace("NAME", "mjx"))
    assert len(found) == 4
    # The solvers end at tolerance 1e-8, each somewhere else below it.
    assert max(far for _, far in found) < 1e-7


@pytest.mark.night
@installed("newton")
def test_what_newton_imports_moves_as_it_does_in_mujoco(tmp_path: Path) -> None:
    (tmp_path / "thrown.xml").write_text(THROWN)
    text = """
version: 1
scene: thrown.xml
duration: 0.2
axes: {engine: [mujoco, newton], timestep: [0.002]}
"""
    found = differences(tmp_path, "newton", text)
    # Single precision resolves 6e-8 of 2 m, in each of 100 steps at most.
    assert max(far for _, far in found) < 100 * 6e-8 * 2


@pytest.mark.night
@pytest.mark.parametrize(
    ("name", "tree"),
    [
        pytest.param("pinocchio", TREE, marks=installed("pinocchio")),
        pytest.param("drake", ARM, marks=installed("drake")),
    ],
    ids=["pinocchio", "drake"],
)
def test_free_motion_is_that_of_other_dynamics(tmp_path: Path, name: str, tree: str) -> None:
    (tmp_path / "tree.xml").write_text(tree)
    text = """
version: 1
scene: tree.xml
duration: 1.0
seeds: 3
drive: {noise: 0.5, rate: 5}
axes: {engine: [mujoco, NAME], timestep: [0.0005, 0.001]}
"""
    found = differences(tmp_path, name, text.replace("NAME", name))
    # Rounding of 2e-16 in each of 2,000 steps, that this motion makes 20 times larger.
    assert [far < 1e-11 for _, far in found] == [True] * 6
    assert all(ours.metrics["joint_travel"] for ours, _ in found)


def drakes(folder: Path, text: str) -> Store:
    request = read_request(text, "drakes", folder / "store", folder=folder, workers=0)
    run_sweep(request, lambda *_: None, lambda _finished: None)
    return Store.open(folder / "store")


DROPS = """
version: 1
scene: ball_drop
duration: 0.9
axes: {engine: [drake], timestep: [0.001, 0.002], restitution: [0.6, 0.8]}
"""


@pytest.mark.night
@installed("drake")
def test_a_ball_of_drake_is_the_implicit_spring_of_its_solref(tmp_path: Path) -> None:
    """SAP ends a step where the spring presses: v' = v + h (K (d - h v') - B v' - g), d > 0."""
    store = drakes(tmp_path, DROPS)
    for record in store.records():
        told, step = store.trace(record).qpos[:, 2], float(str(record.axes["timestep"]))
        stiffness, damping = -np.array(record.settings["solref"], dtype=float)
        expected, speed = [told[0]], 0.0
        for _ in told[1:]:
            depth = 0.05 - expected[-1]
            free = speed - step * 9.81
            held = (free + step * stiffness * depth) / (1 + step * (step * stiffness + damping))
            presses = depth > 0 and held > free
            speed = held if presses else free
            expected.append(expected[-1] + step * speed)
        # Rounding of 2e-16 of 1 m in 900 steps, that bounces make ten times larger.
        assert np.abs(told - expected).max() < 1e-11
        assert told.min() < 0.05


BOXES = """
version: 1
scene: SCENE
duration: DURATION
axes: {engine: [drake], timestep: [0.001, 0.002]}
"""


@pytest.mark.night
@installed("drake")
def test_boxes_of_drake_slide_and_press_as_coulomb_and_newton_say(tmp_path: Path) -> None:
    (tmp_path / "slide").mkdir()
    (tmp_path / "stack").mkdir()
    slide = drakes(
        tmp_path / "slide", BOXES.replace("SCENE", "box_slide").replace("DURATION", ".3")
    )
    for record in slide.records():
        # 1 kg that rests for .3 s; and 2 m/s that friction .5 slows from the first steps on.
        assert record.metrics["normal_impulse"] == pytest.approx(9.81 * 0.3, rel=1e-3)
        slid = 2 * 0.3 - 0.5 * 9.81 * 0.3**2 / 2
        late = 2 * float(str(record.axes["timestep"])) * 0.5 * 9.81 * 0.3
        assert abs(np.ptp(slide.trace(record).qpos[:, 0]) - slid) < late
    stack = drakes(
        tmp_path / "stack", BOXES.replace("SCENE", "box_stack").replace("DURATION", ".5")
    )
    for record in stack.records():
        # Each pair bears what is above it, at rest; the worst of ten.
        assert record.metrics["weights_borne"] == pytest.approx(10, rel=0.01)
