"""What a page that simulates is given: models, changes of them, and the values of sliders."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.reporting.conftest import run

from contactlab.errors import OutputError
from contactlab.live import browser_build
from contactlab.live.browser_build import find_build
from contactlab.live.browser_models import BrowserModel
from contactlab.live.browser_models import model_changes as changes_of
from contactlab.live.live_runs import LiveRuns
from contactlab.live.sliders import offered_values
from contactlab.scene.model_draft import fields_of
from contactlab.scene.scene import Scene
from contactlab.schema.examination import Examination, Fix
from contactlab.store.finished_store import Store

SWEEP = """
version: 1
scene: ball_drop
duration: 0.02
checks: none
axes:
  restitution: [0.2, 0.9]
  timestep: [1.0e-3, 2.0e-3]
  drop_height: {values: [0.5, 1.0], role: scenario}
"""
# A wedge off its origin, scaled, turned and with a texture; its pad is of the same file, and scaled
# by a class.
MESHES = """
<mujoco>
  <compiler meshdir="parts"/>
  <default><default class="small"><mesh scale="0.01 0.01 0.01"/></default></default>
  <asset>
    <texture name="sky" type="2d" builtin="gradient" width="8" height="8"/>
    <material name="blue" texture="sky"/>
    <mesh name="wedge" file="wedge.obj" scale="0.1 0.2 0.1" refpos="1 0 0"/>
    <mesh name="pad" class="small" file="wedge.obj"/>
  </asset>
  <worldbody>
    <geom type="plane" size="1 1 .1" material="blue"/>
    <body pos="0 0 .3" euler="10 20 30"><freejoint/>
      <geom type="mesh" mesh="wedge" euler="5 0 0"/><geom type="mesh" mesh="pad" pos="0 0 .1"/>
    </body>
  </worldbody>
  <actuator/>
</mujoco>
"""
WEDGE = """
v 0 0 0
v 2 0 0
v 0 1 0
v 2 1 0
v 0 0 1
v 0 1 1.5
f 1 3 2
f 2 3 4
f 1 2 5
f 3 6 4
f 1 5 3
f 3 5 6
f 2 4 5
f 4 6 5
"""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return run(SWEEP, tmp_path_factory.mktemp("live"))


def same(one: mujoco.MjModel, other: mujoco.MjModel) -> bool:
    return not changes_of(one, other)


def test_a_model_that_travels_alone_compiles_to_itself(tmp_path: Path) -> None:
    """MJCF has six digits, and meshes are stored in single precision: of lengths below 1 m."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/wedge.obj").write_text(WEDGE)
    (tmp_path / "model.xml").write_text(MESHES)
    scene = Scene.open(str(tmp_path / "model.xml"))
    model = BrowserModel.of(scene, scene.resolve({}, 0, None))
    text, files = model.standalone_mjcf
    again = mujoco.MjModel.from_xml_string(text, dict(files))
    assert again.ntex == 0
    assert len(files) == 2
    for name, value in fields_of(again).items():
        if name.startswith(("geom_", "body_")) and value.dtype.kind == "f":
            np.testing.assert_allclose(
                value, fields_of(model.model)[name], 1e-5, 1e-6, err_msg=name
            )
    for name, numbers in model.numbers.items():
        if "." not in name:
            getattr(again, name).ravel()[:] = numbers
    old, new = fields_of(model.model), fields_of(again)
    for name in (each for each in old if each.startswith(("geom_", "body_"))):
        assert new[name].tobytes() == old[name].tobytes(), name
    steps = mujoco.MjModel.from_binary_path(written(tmp_path / "m.mjb", model.compiled))
    assert fields_of(steps)["mesh_vert"].tobytes() == fields_of(model.model)["mesh_vert"].tobytes()


def written(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    return str(path)


def test_a_slider_at_the_value_of_another_run_gives_that_run(store: Store) -> None:
    runs = LiveRuns(store)
    known = {tuple(record.axes.items()): record.run_id for record in store.records()}
    axes = dict(next(iter(known)))
    own = runs.run(known[tuple(axes.items())])
    assert own.variant is not None
    for slider in (each for each in own.sliders if each.name in axes):
        for stop in slider.stops:
            values = {**axes, slider.name: float(stop.text)}
            if (other := known.get(tuple(values.items()))) is None:
                continue
            theirs = runs.run(other).variant
            assert theirs is not None
            assert same(stop.model, theirs.model)
            assert stop.steps == theirs.steps
            for part, numbers in stop.parts.items():
                np.testing.assert_array_equal(numbers, theirs.parts[part])


def test_a_page_has_sixty_poses_a_second_and_the_last(store: Store) -> None:
    for record in store.records():
        motion = LiveRuns(store).run(record.run_id).motion
        assert motion is not None
        step = float(str(record.axes["timestep"]))
        # A pose is that of the first step at or after each sixtieth of a second.
        gaps = np.diff(motion.times)
        assert (gaps[:-1] >= 1 / 60 - step).all()
        assert (gaps <= 1 / 60 + step).all()
        assert motion.times[-1] == pytest.approx(0.02)


def test_sliders_are_the_swept_axes_first_with_values_between_theirs(store: Store) -> None:
    record = next(iter(store.records()))
    sliders = LiveRuns(store).run(record.run_id).sliders
    names = [slider.name for slider in sliders]
    assert names[:3] == list(record.axes)
    assert "cone" in names
    # A restitution decides solref.
    assert "solref.timeconst" not in names
    for slider in sliders:
        texts = [stop.text for stop in slider.stops]
        assert len(set(texts)) == len(texts)
        if slider.name in record.axes:
            assert texts[slider.own] == f"{record.axes[slider.name]:.4g}"
    heights = [float(stop.text) for stop in sliders[names.index("drop_height")].stops]
    assert heights == sorted(heights)
    assert (heights[0], heights[-1], len(heights)) == (0.5, 1.0, 9)


def test_a_slider_of_many_values_has_that_of_every_run(tmp_path: Path) -> None:
    """A slider has 33 values spread over those of a sweep, besides the run's own."""
    heights = [round(0.5 + 0.01 * place, 2) for place in range(50)]
    text = SWEEP.replace("[0.2, 0.9]", "[0.2]").replace("[1.0e-3, 2.0e-3]", "[2.0e-3]")
    many = run(text.replace("values: [0.5, 1.0]", f"values: {heights}"), tmp_path)
    scene = Scene.open("ball_drop")
    for record in many.records():
        offered = offered_values(scene, many.columns, record, record.axes)
        spec, own, values = next(each for each in offered if each[0].name == "drop_height")
        assert own == record.axes[spec.name]
        assert own in values
        assert values == sorted(values, key=lambda value: float(str(value)))
        assert {heights[0], heights[-1]} <= {*values}
        assert 33 <= len(values) <= 34


@pytest.mark.parametrize(("heights", "step"), [([0.5, 1.0], np.subtract), ([0.05, 1.0], np.divide)])
def test_values_between_swept_ones_are_even_or_have_even_ratios(
    tmp_path: Path, heights: list[float], step: np.ufunc
) -> None:
    """Ratios are even if the largest value is eight times the smallest, or more."""
    text = SWEEP.replace("[0.2, 0.9]", "[0.2]").replace("[1.0e-3, 2.0e-3]", "[2.0e-3]")
    two = run(text.replace("values: [0.5, 1.0]", f"values: {heights}"), tmp_path)
    record = next(iter(two.records()))
    offered = offered_values(Scene.open("ball_drop"), two.columns, record, record.axes)
    values = next(values for spec, _, values in offered if spec.name == "drop_height")
    steps = step(values[1:], values[:-1])
    assert len(values) == 9
    assert steps == pytest.approx(steps[0], rel=1e-3)


def test_what_is_stored_of_a_motion_is_its_end_and_poses(store: Store) -> None:
    record = next(iter(store.records()))
    live = LiveRuns(store).run(record.run_id)
    assert live.motion is not None
    trace = store.trace(record)
    np.testing.assert_array_equal(live.motion.end[0], trace.qpos[-1])
    np.testing.assert_array_equal(live.motion.end[1], trace.qvel[-1])
    assert live.motion.times[-1] == trace.time[-1]


def change(name: str, **keys: object) -> Fix:
    asked = {"name": name, "changes_model": True, "apply": "", "removes": "verdict", "lines": ()}
    return Fix.model_validate(
        {"error": 0, "distance_to_reference": 0, "distance_before": 0, "time_ratio": None}
        | asked
        | keys
    )


def test_changes_of_numbers_are_switches_and_those_of_the_structure_are_not(store: Store) -> None:
    """A joint or an exclude beside a setting: the numbers alone would be another change."""
    settings = {"impratio": 10.0}
    changes = (
        change("friction", settings=settings),
        change("parted", settings=settings, excluded_pairs=(("world", "ball"),)),
        change("freed", settings=settings, added_free_joints=("ball",)),
        change("unknown", settings={"no_such_axis": 1.0}),
    )
    examined = Examination.model_construct(fixes=changes, budget=None)
    live = LiveRuns(store, examined).run(next(iter(store.records())).run_id)
    (switch,) = live.switches
    assert switch.name == "friction"
    assert live.variant is not None
    assert switch.variant.model.opt.impratio == 10
    assert set(changes_of(live.variant.model, switch.variant.model)) == {"opt.impratio"}


def test_without_the_browsers_part_the_error_says_how_to_build_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(browser_build, "_BUILD_FOLDER", tmp_path)
    with pytest.raises(OutputError, match="make live"):
        find_build()


def test_changes_are_what_makes_one_model_of_another(store: Store) -> None:
    runs = LiveRuns(store)
    one, other = (runs.run(record.run_id).variant for record in list(store.records())[:2])
    assert one is not None
    assert other is not None
    assert set(changes_of(one.model, other.model)) == {"opt.timestep"} or same(
        one.model, other.model
    )
