"""What is expected of pairs is judged by the laws of Coulomb, Newton and rolling."""

from pathlib import Path
from typing import Any

import pytest

import contactlab
from contactlab.errors import SceneError, SweepFileError
from contactlab.scene.scene import Scene

G, MU, SPEED, RADIUS, HEIGHT, MASS = 9.81, 0.4, 1.0, 0.05, 0.1, 0.3
STOP = SPEED / (MU * G)
"""When friction has stopped the box [s]."""
GRIP = 2 * SPEED / (7 * MU * G)
"""When a solid ball that starts without spin begins to roll [s]."""
FALL = (2 * HEIGHT / G) ** 0.5
MODEL = f"""<mujoco><option timestep="0.001" cone="elliptic" impratio="10"/>
<default><geom friction="{MU} 0 0" condim="3" mass="{MASS}"/></default>
<worldbody><geom name="floor" type="plane" size="4 4 .1"/>
<body name="box" pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".1 .1 .05"/></body>
<body name="ball" pos="0 1 {RADIUS}"><freejoint/><geom name="ball" size="{RADIUS}"/></body>
<body name="skid" pos="0 2 {RADIUS}"><freejoint/><geom name="skid" size="{RADIUS}"/></body>
<body name="drop" pos="0 3 {HEIGHT + RADIUS}"><freejoint/><geom name="drop" size="{RADIUS}"/></body>
</worldbody><keyframe><key qpos="0 0 .05 1 0 0 0 0 1 {RADIUS} 1 0 0 0 0 2 {RADIUS} 1 0 0 0
 0 3 {HEIGHT + RADIUS} 1 0 0 0" qvel="{SPEED} 0 0 0 0 0 {SPEED} 0 0 0 {SPEED / RADIUS} 0
 {SPEED} 0 0 0 0 0 0 0 0 0 0 0"/></keyframe></mujoco>"""

# A mode shows within 24 ms, of which some pass before it counts.
LATE, EARLY = 0.05, -0.05
MET: list[dict[str, Any]] = [
    {"pair": "floor-box", "mode": "slide", "to": STOP + EARLY},
    {"pair": "box-floor", "mode": "stick", "from": STOP + LATE},
    {"pair": "world-box", "mode": {"first": "slide", "last": "stick"}},
    {"body": "ball", "mode": "rolls"},
    {"body": "skid", "mode": "slide", "to": GRIP + EARLY},
    {"body": "skid", "mode": "rolls", "from": GRIP + LATE},
    {"body": "drop", "mode": "apart", "to": FALL - 0.001},
    {"body": "box", "force": {"min": 0.99 * MASS * G, "max": 1.01 * MASS * G}, "from": 0.6},
    {"body": "b*", "force": {"min": 1.99 * MASS * G, "max": 2.01 * MASS * G}, "from": 0.6},
    {"pair": "*", "depth": {"max": 0.02}},
]
UNMET: list[tuple[dict[str, Any], str, str]] = [
    ({"pair": "floor-box", "mode": "stick"}, "unexpected_slide", "floor-box should stick, but"),
    ({"pair": "floor-box", "mode": "slide"}, "unexpected_stick", "but sticks, from 0.2"),
    ({"body": "skid", "mode": "rolls"}, "unexpected_slide", "floor-skid should roll, but slides"),
    ({"body": "box", "mode": "rolls", "from": 0.5}, "pair_expectation", "does not turn for 0.5 s"),
    ({"body": "drop", "mode": "apart"}, "pair_expectation", "from 0.14"),
    (
        {"body": "drop", "mode": "stick", "to": 0.1},
        "pair_expectation",
        "nothing for 0.1 s, from 0 ",
    ),
    ({"pair": "box-ball", "mode": "slide"}, "pair_expectation", "touches nothing for 1 s"),
    ({"body": "box", "force": {"min": 3}, "from": 0.6}, "pair_expectation", "presses with 2.94 N"),
    ({"body": "box", "force": {"max": 2.9}, "from": 0.6}, "pair_expectation", "with 2.94 N at"),
    ({"pair": "*", "depth": {"max": 1e-5}}, "pair_expectation", "m deep, from 0"),
]


def outcome(folder: Path, **keys: Any) -> Any:
    """Return the record of one run of the model."""
    (folder / "model.xml").write_text(MODEL, encoding="utf-8")
    sweep: dict[str, Any] = {"version": 1, "scene": str(folder / "model.xml"), "duration": 1}
    sweep["drive"] = "none"
    sweep |= keys
    store = contactlab.sweep(sweep, output=folder / "store", workers=0, fresh=True)
    return next(iter(store.records()))


def of_pairs(record: Any) -> list[tuple[str, str]]:
    named = ("unexpected_slide", "unexpected_stick", "pair_expectation")
    return [(each.label, each.reason) for each in record.labels if each.label in named]


def test_what_coulomb_and_newton_say_is_met(tmp_path: Path) -> None:
    assert of_pairs(outcome(tmp_path, pairs=MET)) == []
    record = outcome(tmp_path, expect=MET)
    assert (record.expectation_met, of_pairs(record)) == (True, [])


@pytest.mark.long
@pytest.mark.parametrize(("said", "label", "reason"), UNMET)
def test_the_opposite_is_labelled(
    tmp_path: Path, said: dict[str, Any], label: str, reason: str
) -> None:
    record = outcome(tmp_path, expect=[said])
    assert [name for name, _ in of_pairs(record)] == [label]
    assert reason in of_pairs(record)[0][1]
    assert record.expectation_met is False
    # Of a run that the condition does not select, nothing is expected.
    other = {"where": {"timestep": 1e-3}, **said}
    axes = {"timestep": {"values": [2e-3]}}
    assert of_pairs(outcome(tmp_path, expect=[other], axes=axes)) == []


def test_hops_belong_to_a_slide_and_are_no_bounces(tmp_path: Path) -> None:
    # At rest where friction has taken the energy; what is not recorded between contacts is
    # interpolated, to a few percent of the path.
    axes = {"timestep": {"values": [5e-4]}, "keyframe": ["key[0]"]}
    record = outcome(tmp_path, axes=axes, scene=str(slider(tmp_path)))
    path = SPEED**2 / (2 * MU * G)
    assert record.metrics["slip_distance"] == pytest.approx(path, rel=0.03)
    assert record.metrics["restitution_measured"] is None


def slider(folder: Path) -> Path:
    """Write a model of the box alone, which hops as it slides."""
    body = MODEL[MODEL.index('<body name="ball"') : MODEL.index("</worldbody>")]
    model = MODEL.replace(body, "").replace('impratio="10"', "")
    start = model.index("<keyframe>")
    key = f'<keyframe><key qpos="0 0 .05 1 0 0 0" qvel="{SPEED} 0 0 0 0 0"/></keyframe></mujoco>'
    (folder / "slider.xml").write_text(model[:start] + key, encoding="utf-8")
    return folder / "slider.xml"


def scene(folder: Path, entries: str) -> Path:
    (folder / "scene.xml").write_text(MODEL, encoding="utf-8")
    head = "version: 1\ntitle: t\ndescription: d\nduration: 1\nkeyframe: key[0]\n"
    head += "initial: {late: {default: 0.4, unit: s, description: when}}\n"
    head += "pairs:\n  - {geoms: [floor, box]}\n"
    (folder / "scene.yaml").write_text(head + entries, encoding="utf-8")
    return folder


@pytest.mark.long
def test_a_scene_says_it_of_its_own_pairs(tmp_path: Path) -> None:
    entries = "  - {geoms: [floor, ball], mode: rolls}\n  - {body: box, mode: slide, from: late}\n"
    (tmp_path / "scene").mkdir()
    path = scene(tmp_path / "scene", entries)
    sweep = {"version": 1, "scene": f"{path}/", "axes": {"late": [0.0, 0.4]}}
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0)
    found = [of_pairs(record) for record in store.records()]
    for each, start in zip(found, ("0.246", "0.4"), strict=True):
        reason = f"floor-box should slide, but sticks, from {start} s on"
        assert each == [("unexpected_stick", reason)]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{pair: floor-bax, mode: stick}", r"pairs.1.pair: 'floor-bax' names .* 'floor-box'"),
        ("{body: ball, mode: rolls}", "pairs.1.body: 'ball' names no monitored pair"),
        ("{body: box, mode: stick, from: late * 3}", "pairs.1.from: 1.2 s is not within the run"),
        ("{body: box, mode: stick, to: 2}", "pairs.1.to: 2 s is not after 0 s and within"),
        ("{body: box, mode: stick, to: lat}", "pairs.1.to: .* write one of late"),
        ("{body: box, force: {min: 2, max: 1}}", "pairs.1.force: has a min above its max"),
        ("{body: box, mode: roll}", "pairs.1.mode: Input should be 'stick'"),
        ("{geoms: [floor, ball], body: box}", "pairs.1: needs mode, force or depth"),
        ("{slots: 3}", "takes exactly one of geoms, bodies and chain"),
    ],
)
def test_mistakes_of_a_scene_are_named(tmp_path: Path, entry: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Scene.open(f"{scene(tmp_path, f'  - {entry}')}/")


@pytest.mark.parametrize(
    ("said", "key"),
    [
        ({"pair": "floor-bax", "mode": "stick"}, "pair"),
        ({"body": "arm*", "mode": "stick"}, "body"),
        ({"body": "box", "mode": "stick", "from": 1}, "from"),
        ({"body": "box", "mode": "stick", "from": 0.5, "to": 0.2}, "to"),
        ({"body": "box", "mode": "stick", "to": "speed"}, "to"),
        ({"body": "box", "force": {"min": 2, "max": 1}}, "force"),
        ({"body": "box", "depth": {"max": 0}}, "depth.max"),
    ],
)
def test_mistakes_of_a_sweep_are_at_their_place(
    tmp_path: Path, said: dict[str, Any], key: str
) -> None:
    for part in ("pairs", "expect"):
        with pytest.raises(SweepFileError) as caught:
            outcome(tmp_path, **{part: [{"body": "box", "mode": "stick"}, said]})
        assert str(caught.value).count("error[") == 1
        assert f"{part}[1].{key}" in str(caught.value)
