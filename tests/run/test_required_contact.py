"""What pairs must do is judged by the laws of Coulomb, Newton and rolling."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import contactlab
from contactlab.errors import SceneError, SweepFileError
from contactlab.scene.scene import Scene
from contactlab.schema.requirement import read_requirement

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
MET = [
    f"slides(floor-box, until: {STOP + EARLY})",
    f"sticks(box-floor, from: {STOP + LATE})",
    "slides(world-box, first)",
    "sticks(world-box, last)",
    "rolls(ball)",
    f"slides(skid, until: {GRIP + EARLY})",
    f"rolls(skid, from: {GRIP + LATE})",
    f"apart(drop, until: {FALL - 0.001})",
    f"presses(box, {0.99 * MASS * G}..{1.01 * MASS * G} N, from: 0.6 s)",
    f"presses(b*, {1.99 * MASS * G}..{2.01 * MASS * G} N, from: 0.6 s)",
    "shallow(*, 2 cm)",
]
UNMET = [
    ("sticks(floor-box)", "pair_expectation", "floor-box should stick, but"),
    ("slides(floor-box)", "pair_expectation", "but sticks, from 0.2"),
    ("sticks(floor-box, first)", "pair_expectation", "should stick first, but slides"),
    ("rolls(skid)", "pair_expectation", "floor-skid should roll, but slides"),
    ("rolls(box, from: 0.5)", "pair_expectation", "does not turn for 0.5 s"),
    ("apart(drop)", "pair_expectation", "from 0.14"),
    ("sticks(drop, until: 0.1 s)", "pair_expectation", "nothing for 0.1 s, from 0 "),
    ("slides(box-ball)", "pair_expectation", "touches nothing for 1 s"),
    ("presses(box, 3 N.., from: 0.6)", "pair_expectation", "presses with 2.94 N"),
    ("presses(box, ..2.9 N, from: 0.6)", "pair_expectation", "with 2.94 N at"),
    ("shallow(*, 10 um)", "pair_expectation", "m deep, from 0"),
    ("still(box, 1 mm)", "broken_requirement", "still(box, 1 mm): moves by up to"),
]


def outcome(folder: Path, **keys: Any) -> Any:
    """Return the record of one run of the model."""
    (folder / "model.xml").write_text(MODEL, encoding="utf-8")
    sweep: dict[str, Any] = {"version": 1, "scene": str(folder / "model.xml"), "duration": 1}
    sweep["drive"] = "none"
    sweep |= keys
    store = contactlab.sweep(sweep, output=folder / "store", workers=0, fresh=True)
    return next(iter(store.records()))


def broken(record: Any) -> list[tuple[str, str]]:
    named = ("pair_expectation", "broken_requirement")
    return [(each.label, each.reason) for each in record.labels if each.label in named]


def margin_of(folder: Path, *must: str) -> float:
    return outcome(folder, must=[*must]).metrics["requirement_margin"]


@pytest.mark.long
def test_a_margin_is_positive_where_all_holds_and_negative_where_not(tmp_path: Path) -> None:
    """All of `MET` together, and each of `UNMET` by itself, as labels tell."""
    assert 0 < margin_of(tmp_path, *MET) < 0.01
    for text, *_ in UNMET:
        assert margin_of(tmp_path, text) < 0, text
    assert margin_of(tmp_path, *MET, UNMET[0][0]) < 0
    assert outcome(tmp_path).metrics["requirement_margin"] is None


@pytest.mark.long
def test_a_margin_is_the_share_of_a_limit_that_is_left(tmp_path: Path) -> None:
    """A box stops after v^2 / (2 mu g), and weighs m g; what never touches is apart by all.

    The box also creeps once it has stopped, by less than 2 % of its way in a second.
    """
    way = SPEED**2 / (2 * MU * G)
    assert margin_of(tmp_path, f"stays(box, {2 * way} m)") == pytest.approx(0.5, abs=0.01)
    assert margin_of(tmp_path, f"stays(box, {way / 2} m)") == pytest.approx(-1, abs=0.04)
    weight = MASS * G
    for text in (f"presses(box, {weight / 2} N.., from: 0.6 s)", "presses(box, ..1 N, from: 0.6)"):
        bound = weight / 2 if ".., " in text else 1.0
        share = (weight - bound) / bound * (1 if ".., " in text else -1)
        assert margin_of(tmp_path, text) == pytest.approx(share, rel=2e-3)
    assert margin_of(tmp_path, f"apart(drop, until: {FALL - 0.01})") == 1
    # It slides for so long, where 20 ms count.
    slid = margin_of(tmp_path, "sticks(floor-box)")
    assert slid == pytest.approx(1 - STOP / 0.02, abs=0.05 / 0.02)


def test_what_coulomb_and_newton_say_is_met(tmp_path: Path) -> None:
    assert broken(outcome(tmp_path, must=MET)) == []
    record = outcome(tmp_path, expect=[{"must": MET}])
    assert (record.expectation_met, broken(record)) == (True, [])


@pytest.mark.long
@pytest.mark.parametrize(("said", "label", "reason"), UNMET)
def test_the_opposite_is_labelled(tmp_path: Path, said: str, label: str, reason: str) -> None:
    record = outcome(tmp_path, expect=[{"must": said}])
    assert [name for name, _ in broken(record)] == [label]
    assert reason in broken(record)[0][1]
    assert record.expectation_met is False
    # Of a run that the condition does not select, nothing is expected.
    other = {"where": {"timestep": 1e-3}, "must": said}
    axes = {"timestep": {"values": [2e-3]}}
    assert broken(outcome(tmp_path, expect=[other], axes=axes)) == []


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
    head += "pairs: [{geoms: [floor, box]}, {geoms: [floor, ball]}]\n"
    (folder / "scene.yaml").write_text(head + entries, encoding="utf-8")
    return folder


@pytest.mark.long
def test_times_may_be_those_of_the_scene(tmp_path: Path) -> None:
    must = 'must: [rolls(ball), "slides(box, from: late)"]\n'
    (tmp_path / "scene").mkdir()
    path = scene(tmp_path / "scene", must)
    sweep = {"version": 1, "scene": f"{path}/", "axes": {"late": [0.0, 0.4]}}
    for said in ({}, {"must": "slides(box, from: max(late, 0.1))"}):
        store = contactlab.sweep(sweep | said, output=tmp_path / "store", workers=0, fresh=True)
        found = [broken(record) for record in store.records()]
        for labels, start in zip(found, ("0.246", "0.4"), strict=True):
            reason = f"floor-box should slide, but sticks, from {start} s on"
            assert ("pair_expectation", reason) in labels


@pytest.mark.parametrize(
    ("must", "message"),
    [
        ("sticks(floor-bax)", r"must.1: 'sticks.*' names .* 'floor-box'"),
        ("rolls(bal)", "'bal' names no monitored pair; did you mean 'ball'"),
        ("'sticks(box, from: late * 3)'", "1.2 s is outside the run"),
        ("'sticks(box, until: 2)'", "2 s is after the end of the run"),
        ("'sticks(box, from: late, until: 0.3)'", "0.3 s is not after 0.4 s"),
        ("'sticks(box, until: lat)'", "`until` goes from unknown lat; write one of late"),
        ("'presses(box, 2..1 N)'", "must.1: .* has its least above its most"),
        ("roll(box)", "must.1: no requirement 'roll'; did you mean 'rolls'"),
    ],
)
def test_mistakes_of_a_scene_are_named(tmp_path: Path, must: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Scene.open(f"{scene(tmp_path, f'must: [rolls(ball), {must}]')}/")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("presses(box)", "'presses' is written presses(pad-box, 1..5 N)"),
        ("presses(box, 5 N)", "'5 N' is no range here; write presses(pad-box, 1..5 N), 1 N.."),
        ("presses(box, 1..5)", "'1..5' is no range here"),
        ("presses(box, 1..5 mm)", "'1..5 mm' is no range here"),
        ("presses(box, ..)", "'..' is no range here"),
        ("presses(box, 1..2..3 N)", "is no range here"),
        ("rolls(box, first)", "'rolls' is written rolls(ball)"),
        ("slides(box, middle)", "'slides' is written slides(box, first)"),
        ("shallow(box, 1 N)", "'1 N' is not a tolerance here"),
        ("sticks(box, from: 1 +)", "`from: 1 +` is no time"),
    ],
)
def test_what_is_written_wrongly_is_refused_with_what_to_write(text: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        read_requirement(text)


def test_ranges_have_units() -> None:
    ranges = {"1..5 N": (1, 5), "500 mN..": (0.5, np.inf), "..1 kN": (-np.inf, 1000)}
    for text, ends in ranges.items():
        said = read_requirement(f"presses(pad-box, {text})")
        assert (said.least, said.limit) == ends


@pytest.mark.parametrize("part", ["must", "expect"])
@pytest.mark.parametrize(
    "said", ["sticks(floor-bax)", "sticks(arm*)", "sticks(box, from: 1)", "sticks(box, until: v)"]
)
def test_mistakes_of_a_sweep_are_at_their_place(tmp_path: Path, part: str, said: str) -> None:
    must = ["sticks(box)", said]
    with pytest.raises(SweepFileError) as caught:
        outcome(tmp_path, **{part: must if part == "must" else [{"must": must}]})
    assert str(caught.value).count("error[") == 1
    place = "must[1]" if part == "must" else "expect[0].must[1]"
    assert place in str(caught.value)


# Keys that once said it, and the words that say it now.
FORMERLY: list[tuple[dict[str, Any], str, str]] = [
    ({"mode": "slide"}, "mode", 'must: ["slides(X)"]'),
    (
        {"mode": {"first": "slide", "last": "stick"}},
        "mode",
        '"slides(X, first)", "sticks(X, last)"',
    ),
    ({"force": {"min": 1, "max": 5}}, "force", "presses(X, 1..5 N)"),
    ({"force": {"min": 1}}, "force", "presses(X, 1 N..)"),
    ({"depth": {"max": 0.001}}, "depth", "shallow(X, 0.001 m)"),
    ({"pair": "floor-*"}, "pair", "WORD(floor-*)"),
    ({"to": 0.5}, "to", "WORD(X, until: 0.5)"),
]


@pytest.mark.parametrize(("entry", "key", "now"), FORMERLY)
def test_an_old_key_is_refused_with_the_words_of_now(
    tmp_path: Path, entry: dict[str, Any], key: str, now: str
) -> None:
    with pytest.raises(SweepFileError) as caught:
        outcome(tmp_path, expect=[{"label": "stable", **entry}])
    assert f"expect[0].{key}" in str(caught.value)
    assert now in str(caught.value)
    written = json.dumps({"geoms": ["floor", "skid"], **entry})
    with pytest.raises(SceneError, match=rf"pairs\.2\.{key}: `{key}` is .*{re.escape(now)}"):
        Scene.open(_with(tmp_path, written))


def _with(folder: Path, pair: str) -> str:
    """Return a scene with one more entry of pairs."""
    path = scene(folder, "") / "scene.yaml"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("ball]}]", f"ball]}}, {pair}]"), encoding="utf-8")
    return f"{folder}/"


def test_keys_of_all_pairs_are_refused_too(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r'modes: `modes` is `must: \["sticks\(\*, last\)"\]` now'):
        Scene.open(f"{scene(tmp_path, 'modes: {last: stick}')}/")
    with pytest.raises(SweepFileError, match=r"`pairs` is `must: .*presses\(pad-box, 1..5 N\)"):
        outcome(tmp_path, pairs=[{"body": "box", "mode": "stick"}])
