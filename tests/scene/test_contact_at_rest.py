"""Contacts by what they are at rest: linear springs, depths under loads, and what is refused."""

from pathlib import Path

import mujoco
import pytest

import contactlab
from contactlab.contact.contact_laws import stiffness_damping
from contactlab.errors import SceneError, SweepFileError
from contactlab.scene.scene import Scene

GRAVITY = 9.81
BALL = """<mujoco><option cone="{cone}" impratio="{impratio}"/><worldbody>
<geom name="floor" type="plane" size="1 1 .1" condim="{condim}" friction="{friction}"/>
<body name="ball" pos="0 0 {height}"><freejoint/>
<geom name="ball" size=".05" mass="2" condim="{condim}" friction="{friction}"/></body>
</worldbody></mujoco>"""
CONES = [
    ("elliptic", 3, 0.5, 1),
    ("elliptic", 6, 0.5, 10),
    ("pyramidal", 1, 0.5, 1),
    ("pyramidal", 3, 0.5, 1),
    ("pyramidal", 3, 1.3, 4),
    ("pyramidal", 4, 0.8, 1),
]
BEAMS = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
<body name="light" pos="0 0 .05"><freejoint/><geom name="light" type="box" size=".05 .05 .05"
 mass="1"/></body>
<body name="heavy" pos="{place}"><freejoint/><geom name="heavy" type="box" size=".05 .05 .05"
 mass="{mass}"/></body></worldbody></mujoco>"""


def written(folder: Path, text: str) -> str:
    (folder / "model.xml").write_text(text)
    return str(folder / "model.xml")


def ball(folder: Path, cone: str, condim: int, friction: float, impratio: float) -> str:
    said = {"cone": cone, "condim": condim, "friction": friction, "impratio": impratio}
    return written(folder, BALL.format(**said, height=0.05))


def depth_at_end(model: str, values: dict[str, object]) -> float:
    """Return how deep the ball is after 6 s of a plain loop [m]."""
    scene = Scene.open(model)
    run = scene.resolve(values, 0, 6.0)
    prepared = scene.prepare(run, scene.initial_states([run])).model
    data = mujoco.MjData(prepared)
    mujoco.mj_step(prepared, data, run.steps)
    return -float(data.contact.dist[0])


# The slowest, w = sqrt(5e3 * 0.5 * 0.05 * 0.156) = 4.4 / s, closes in as (1 + w t) exp(-w t), 1e-10
# at 6 s; the solver's tolerance of 1e-8 leaves more.
@pytest.mark.parametrize("stiffness", [5e3, 2e5])
@pytest.mark.parametrize(("cone", "condim", "friction", "impratio"), CONES)
def test_a_stiff_contact_is_a_spring(
    tmp_path: Path, stiffness: float, cone: str, condim: int, friction: float, impratio: float
) -> None:
    """The depth is weight over stiffness, of every cone."""
    model = ball(tmp_path, cone, condim, friction, impratio)
    depth = depth_at_end(model, {"stiffness": stiffness})
    assert depth == pytest.approx(2 * GRAVITY / stiffness, rel=1e-4)


@pytest.mark.parametrize(("cone", "condim", "friction", "impratio"), CONES)
def test_a_contact_is_as_deep_as_asked(
    tmp_path: Path, cone: str, condim: int, friction: float, impratio: float
) -> None:
    """Loads are exact but for the impedance that finds them, 1 - 1e-4, and its share of F."""
    model = ball(tmp_path, cone, condim, friction, impratio)
    assert depth_at_end(model, {"depth_at_rest": 3e-4}) == pytest.approx(3e-4, rel=1e-3)


def test_restitution_and_mass_come_before(tmp_path: Path) -> None:
    """A ball of 5 kg, as stiff; its damping ratio is that of the restitution."""
    scene = Scene.open(ball(tmp_path, "elliptic", 3, 0.5, 1))
    run = scene.resolve({"mass": 5.0, "restitution": 0.6, "stiffness": 1e4}, 0, 1.0)
    (pair,) = scene.base({}).prepare(run.list_edits()).pairs.values()
    assert pair.solref[1] == pytest.approx(0.1809, rel=1e-3)
    # K = k A (1 - d), and the time constant is 1 / (zeta sqrt K).
    assert pair.solref[0] == pytest.approx(1 / (0.1809 * (1e4 / 5 * 0.05) ** 0.5), rel=1e-3)
    assert pair.solimp[0] == pair.solimp[1] == 0.95


def test_each_pair_of_a_stack_has_its_own(tmp_path: Path) -> None:
    """Two boxes sink by (m1 + m2) g / 4k and m2 g / 4k, though they share a geom."""
    model = written(tmp_path, BEAMS.format(place="0 0 .15", mass=3))
    store = contactlab.sweep(
        {"version": 1, "scene": model, "axes": {"stiffness": ["20 kN/m"]}, "trace": "all"},
        output=tmp_path / "store",
        workers=0,
    )
    (record,) = store.records()
    trace = store.trace(record)
    sunk = 0.15 - float(trace.qpos[-1, 9])
    assert sunk == pytest.approx((4 + 3) * GRAVITY / 4 / 2e4, rel=1e-3)
    assert (record.metrics["at_rest_error"] or 0) < 1e-3
    assert [each.label for each in record.labels] == ["stable"]


def test_what_bears_no_load_has_no_depth(tmp_path: Path) -> None:
    """A box in the air bears nothing: it has a stiffness once it lands, and no depth before."""
    tower = BEAMS.format(place="0 0 .2", mass=2)
    store = contactlab.sweep(
        {"version": 1, "scene": written(tmp_path, tower), "axes": {"stiffness": [2e4]}},
        output=tmp_path / "stiff",
        workers=0,
    )
    (record,) = store.records()
    assert (record.metrics["at_rest_error"] or 0) < 1e-3
    high = written(
        tmp_path, BALL.format(cone="elliptic", condim=3, friction=1, impratio=1, height=1)
    )
    with pytest.raises(SceneError, match="no pair carries a load at the start of the model"):
        contactlab.sweep(
            {"version": 1, "scene": high, "axes": {"depth_at_rest": [1e-4]}},
            output=tmp_path / "deep",
            workers=0,
        )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"stiffness": 1e9}, r"stiffness 1e\+09 N/m needs a timestep of at most .* it is 0.002 s"),
        ({"depth_at_rest": 0.06}, "60 mm is deeper than the smaller geom, which reaches 50 mm"),
        ({"stiffness": 1e4, "solref.damping": 0.0}, "damping ratio of solref is not above 0"),
    ],
)
def test_what_has_no_meaning_is_refused(
    tmp_path: Path, values: dict[str, object], message: str
) -> None:
    scene = Scene.open(ball(tmp_path, "elliptic", 3, 0.5, 1))
    run = scene.resolve(values, 0, 1.0)
    with pytest.raises(SceneError, match=message):
        scene.base({}).prepare(run.list_edits())


def test_geoms_that_cannot_have_both_are_refused(tmp_path: Path) -> None:
    """A mean of two geoms' time constants cannot be short for one pair and long for the others."""
    scene = Scene.open(written(tmp_path, BEAMS.format(place=".2 0 .05", mass=100)))
    run = scene.resolve({"stiffness": 1e4}, 0, 1.0)
    with pytest.raises(SceneError, match="no solref of the geoms gives each pair its value"):
        scene.base({}).prepare(run.list_edits())


def test_two_words_for_one_thing_are_refused(tmp_path: Path) -> None:
    axes = {"stiffness": [1e4], "solref": ["0.02 1"]}
    with pytest.raises(SweepFileError, match="sets the same thing"):
        contactlab.sweep(
            {"version": 1, "scene": "box_stack", "axes": axes}, output=tmp_path, workers=0
        )


def test_force_begins_at_the_margin(tmp_path: Path) -> None:
    """A ball that its margin of 3 mm carries is as stiff there; a gap adds no force."""
    text = BALL.format(cone="pyramidal", condim=3, friction=1, impratio=1, height=0.053)
    text = text.replace('name="ball" size', 'margin="0.003" gap="0.001" name="ball" size')
    axes = {"stiffness": ["20 kN/m"]}
    store = contactlab.sweep(
        {"version": 1, "scene": written(tmp_path, text), "axes": axes, "trace": "all"},
        output=tmp_path / "store",
        workers=0,
    )
    (record,) = store.records()
    height = float(store.trace(record).qpos[-1, 2])
    assert height == pytest.approx(0.05 + 0.003 - 2 * GRAVITY / 2e4, abs=1e-7)
    assert (record.metrics["at_rest_error"] or 0) < 1e-3


def test_what_does_not_come_out_is_said(tmp_path: Path) -> None:
    """A box of 1 kg, and another that lands on it once it is weighed: twice as deep as asked."""
    written(tmp_path, BEAMS.format(place="0 0 .16", mass=1))
    (tmp_path / "scene.yaml").write_text(
        "version: 1\ntitle: boxes\ndescription: boxes\nduration: 2\nmodel: model.xml\n"
        "pairs: [{geoms: [floor, light]}]\n"
    )
    store = contactlab.sweep(
        {"version": 1, "scene": str(tmp_path), "axes": {"depth_at_rest": [".1 mm"]}},
        output=tmp_path / "store",
        workers=0,
    )
    (record,) = store.records()
    # The impedance rises with depth, so that twice the load is less than twice as deep.
    assert 0.5 < (record.metrics["at_rest_error"] or 0) < 1
    assert record.labels[0].label == "oracle_miss"
    assert "at rest, the relative error of the requested value is" in record.labels[0].reason


@pytest.mark.parametrize("mixes", [(1, 1, 1), (1, 3, 2), (2, 3, 1), (1, 5, 2)])
def test_however_geoms_mix_each_pair_has_its_own(
    tmp_path: Path, mixes: tuple[float, float, float]
) -> None:
    """K of each two of three geoms is k A (1 - d), with A = 1/m1 + 1/m2, whatever their weights.

    Solref and solimp are written to geoms, and mixed by MuJoCo again: exact but for rounding.
    """
    text, inverse = (
        BEAMS.format(place="0 0 .15", mass=3),
        {"floor": 0.0, "light": 1, "heavy": 1 / 3},
    )
    for geom, mix in zip(inverse, mixes, strict=True):
        text = text.replace(f'<geom name="{geom}"', f'<geom name="{geom}" solmix="{mix}"')
    scene = Scene.open(written(tmp_path, text))
    prepared = scene.base({}).prepare(scene.resolve({"stiffness": 2e4}, 0, 1.0).list_edits())
    assert len(prepared.pairs) == 3
    for name, pair in prepared.pairs.items():
        first, second = name.split("-")
        stiffness = 2e4 * (inverse[first] + inverse[second]) * (1 - pair.solimp[0])
        assert pair.solimp[:2] == pytest.approx((0.95, 0.95))
        assert float(stiffness_damping(pair.solref)[0]) == pytest.approx(stiffness, rel=1e-6)
