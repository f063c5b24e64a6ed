"""Derivatives through contact against closed forms, and what a report says of them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contactlab.contact.contact_laws import restitution_from_damping
from contactlab.errors import EngineError, StoppedError, SweepFileError
from contactlab.resources import SWEEPS
from contactlab.run.sweep_request import SceneLoader
from contactlab.schema.gradients import Difference, GradientInput, GradientsReport
from contactlab.studies.gradients import differentiating
from contactlab.studies.gradients.automatic_differentiation import engine
from contactlab.studies.gradients.derivatives import METHODS, Differentiation
from contactlab.studies.gradients.differentiating import (
    REPORT,
    GradientsRequest,
    differentiate_scene,
    find_mode_switches,
)
from contactlab.studies.gradients.end_states import DifferentiatedScene, Parameter, Point
from contactlab.tasks.session import Session, Values

GRADIENTS = SWEEPS / "gradients"
GRAVITY = 9.81
GAP = 1.0137  # between the ball and the wall [m]


def subject_of(name: str, of: str, threads: int = 1) -> DifferentiatedScene:
    scene = SceneLoader(GRADIENTS).open(name).with_drive("none", Path())
    return DifferentiatedScene.of(scene, of, None, threads)


def differentiated(
    subject: DifferentiatedScene, by: str, values: Values, finer: int = 2
) -> GradientInput:
    """Return the derivative at some values, its words left out."""
    how = Differentiation(subject, finer, METHODS["chain"], ladder=False)
    (found,) = how.by(subject.find_parameter(by), [Point(values, {})])
    return found


def rebound(stiffness: float, damping: float) -> float:
    """Return the restitution of MuJoCo's contact, a linear spring and damper that only pushes."""
    return float(restitution_from_damping(damping / (2 * math.sqrt(stiffness))))


def closed_form_of_ball(by: str, values: dict[str, float]) -> float:
    """Return the derivative of -e v, the speed away from the wall, by central differences of it.

    A difference over 1e-4 of the parameter is off by 1e-8 of a function as smooth as this.
    """

    def leaves(at: float) -> float:
        given = values | {by: at}
        return -given["speed"] * rebound(given["solref.stiffness"], given["solref.damping"])

    at, span = values[by], 1e-4 * values[by]
    return (leaves(at + span) - leaves(at - span)) / (2 * span)


def inside(found: GradientInput, expected: float, share: float) -> None:
    """Check that the model's derivative is within its bound, which is a share of it at most."""
    assert found.model.value is not None
    assert found.model.bound is not None
    assert abs(found.model.value - expected) <= found.model.bound
    assert found.model.bound <= share * abs(expected)


BALL = {"speed": 1.9, "solref.stiffness": 4e4, "solref.damping": 72.35}


def test_a_ball_against_a_wall_has_restitutions_derivative() -> None:
    """What its own run says is another: at steps of 1 ms, tens of times as much.

    The damper's force sets in at the full speed, so that the depth of the first step within the
    wall, from 0 to v h, decides up to B h of the rebound, over a speed of h v^2 / gap: the slope
    within a tooth is about B gap / v = 39, whatever h.
    """
    found = differentiated(subject_of("ball", "x.v"), "speed", BALL)
    inside(found, closed_form_of_ball("speed", BALL), share=0.3)
    assert found.run.value is not None
    assert abs(found.run.value) > 10 * rebound(4e4, 72.35)


@pytest.mark.long
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(n, marks=pytest.mark.night) for n in range(1, 6))]
)
@pytest.mark.parametrize("by", ["speed", "solref.stiffness", "solref.damping"])
def test_any_ball_has_restitutions_derivative(seed: int, by: str) -> None:
    """The bound is no more than .6 of the derivative where that is a hundredth of the speed."""
    low, high = np.array([1.4, 2e4, 20.0]), np.array([3.0, 6e4, 200.0])
    drawn = np.random.default_rng(seed).uniform(low, high)
    values = dict(zip(BALL, drawn.tolist(), strict=True))
    found = differentiated(subject_of("ball", "x.v"), by, values, finer=4)
    inside(found, closed_form_of_ball(by, values), share=0.6)


@pytest.mark.parametrize(
    ("by", "expected"),
    [
        pytest.param("push", 0.5, id="push", marks=pytest.mark.long),
        pytest.param("friction.slide", -GRAVITY / 2, id="friction"),
    ],
)
def test_a_push_that_slips_has_newtons_derivative(by: str, expected: float) -> None:
    """What slides all the time has x = (F / m - mu g) T^2 / 2, with m = 1 kg, and here T = .5 s.

    Friction is mu times the normal force, whose impulse is m g T but for the change of vz, and x
    differs by mu times the change of z, .4 mm at most: its share in the derivative by mu is 3e-4.
    """
    subject = replace(subject_of("push", "x"), duration=0.5)
    inside(differentiated(subject, by, {"push": 6.0}), expected / 4, share=0.02)


@pytest.mark.long
def test_a_push_that_sticks_goes_nowhere() -> None:
    """It creeps at (1 - d) F / (m B), a millimetre a second for each newton: d is .9, B 100 / s."""
    found = differentiated(replace(subject_of("push", "x"), duration=0.5), "push", {"push": 3.0})
    assert found.model.value is not None
    assert 0 <= found.model.value < 0.5e-3


@pytest.mark.long
def test_transition_matrices_are_the_runs_own() -> None:
    """Chained with a small step, the matrices are the run's derivative; with 1e-6 they need not be.

    A puck that slides hops by less than a micrometre. The differences of a step are off by 1e-9 of
    its second derivative and by 1e-16 / 1e-9 of rounding: together 1e-4 at most after 200 steps.
    """
    fast: Values = {"speed": 6.0}
    for name, of, by, values in (("ball", "x.v", "speed", fast), ("push", "x", "push", {})):
        found = differentiated(replace(subject_of(name, of), duration=0.2), by, values)
        assert found.run.value is not None
        assert found.methods["chain"] == pytest.approx(found.run.value, rel=1e-3)
        beyond = found.methods["chain 1e-6"]
    assert beyond is not None
    assert abs(beyond) > 1e3


@pytest.mark.long
def test_a_coordinate_of_the_start_is_a_parameter(tmp_path: Path) -> None:
    """In free fall the end moves with the speed at the start by the time, in run and model.

    Both are linear, so that rounding is all: 1e-16 of a metre over spans of .1 m/s.
    """
    path = tmp_path / "fall.xml"
    path.write_text(
        '<mujoco><worldbody><body name="ball"><freejoint name="ball"/>'
        '<geom type="sphere" size=".1" mass="1"/></body></worldbody></mujoco>'
    )
    (place,) = differentiate_scene(
        GradientsRequest(str(path), "ball.z", ["ball.vz", "ball.z"], ["duration=0.1"]),
        Session(tmp_path / "out"),
    ).places
    for name, expected in (("ball.vz", 0.1), ("ball.z", 1.0)):
        by = place.inputs[name]
        assert by.run.value == pytest.approx(expected, abs=1e-10)
        assert by.methods["chain"] == pytest.approx(expected, abs=1e-5)
        assert set(by.verdicts.values()) == {"agrees"}


def test_threads_change_no_bit() -> None:
    one, two = (subject_of("push", "x", threads) for threads in (1, 2))
    points = [Point({"push": force}, {}) for force in (3.0, 5.0, 6.0, 7.0)]
    assert one.end_values(points).tobytes() == two.end_values(points).tobytes()


def slips(modes: Sequence[str]) -> list[bool]:
    return ["slide" in mode for mode in modes]


def test_the_push_slips_from_friction_times_weight_on() -> None:
    """In the cell of the map that is shipped in which it lies, of .25 N."""
    subject, forces = subject_of("push", "x"), np.linspace(2, 8, 25)
    for friction in (0.3, 0.45, 0.6):
        points = [Point({"push": float(x), "friction.slide": friction}, {}) for x in forces]
        first = slips(subject.contact_modes(points)).index(True)
        assert forces[first - 1] <= friction * GRAVITY <= forces[first]


def test_the_ball_touches_from_the_speed_on_that_the_way_takes() -> None:
    """In the cell of the map that is shipped, .1 m/s, in which v T + u T^2 / 2 is the gap."""
    subject, speeds = subject_of("ball", "x.v"), np.linspace(0.3, 2.3, 21)
    for push in (-0.6, 0.0, 0.6):
        points = [Point({"speed": float(x), "push": push}, {}) for x in speeds]
        modes = subject.contact_modes(points)
        first = next(place for place, mode in enumerate(modes) if mode != "wall-ball: apart")
        assert speeds[first - 1] <= GAP - push / 2 <= speeds[first]


MAP = """version: 1
scene: {scene}
drive: none
duration: 0.2
axes: {{push: [3.0, 6.0, 7.0], friction.slide: [0.5]}}
"""


@pytest.mark.long
def test_a_map_counts_words_and_switches(tmp_path: Path) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(MAP.format(scene=GRADIENTS / "push"))
    report = differentiate_scene(GradientsRequest(str(path), "x"), Session(tmp_path / "out"))
    assert list(report.axes) == ["push"]
    assert report.mode_switches == 1
    assert list(find_mode_switches(report.axes, report.places)) == [(0, 1)]
    (band,) = report.bands
    words = [place.inputs["push"].verdicts["run"] for place in report.places]
    assert words[0] == words[2] == "agrees"
    assert sum(band.counts.values()) == len(words)
    unusable = sum(word != "agrees" for word in words)
    assert band.share == unusable / len(words)
    assert band.widths["push"] == pytest.approx(unusable * (7 - 3) / 2)
    written = GradientsReport.model_validate_json((tmp_path / "out" / REPORT).read_bytes())
    assert written == report


def test_a_map_goes_on_where_it_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a folder has of the same question is read; of another, it is made.

    Derivatives are the count of calls that made them, so that it shows which call a report has.
    """
    path, made = tmp_path / "map.yaml", list[int]()
    path.write_text(MAP.format(scene=GRADIENTS / "push"))

    def counted(
        how: Differentiation, parameter: Parameter, points: Sequence[Point]
    ) -> list[GradientInput]:
        made.append(len(points))
        if len(made) == 2:
            raise StoppedError("interrupted")
        told = Difference(value=float(len(made)), bound=0.0, span=0.1)
        at = parameter.at(how.subject, points[0])
        return [
            GradientInput(value=at, model=told, run=told, methods={}, verdicts={}, ladder=())
        ] * len(points)

    monkeypatch.setattr(Differentiation, "by", counted)
    monkeypatch.setattr(differentiating, "_BATCH_SIZE", 2)
    request, session = GradientsRequest(str(path), "x", ["push"]), Session(tmp_path / "out")
    with pytest.raises(StoppedError):
        differentiate_scene(request, session)
    report = differentiate_scene(request, session)
    assert made == [2, 1, 1]
    assert [place.inputs["push"].run.value for place in report.places] == [1, 1, 3]
    assert differentiate_scene(request, session) == report
    assert len(made) == 3
    differentiate_scene(replace(request, refinement=3), session)
    assert made[3:] == [2, 1]


@pytest.mark.parametrize(
    ("of", "by", "assign", "said"),
    [
        ("x.w", ["push"], [], "no such coordinate"),
        ("x", ["nothing"], [], "write one of puck.fx, .*, or of `contactlab list axes SCENE`"),
        ("x", ["timestep"], [], "nothing is differentiated"),
        ("x", ["cone"], [], "nothing is differentiated.*; write an axis of numbers"),
        ("x", ["pusch"], [], "push"),
        ("x", ["solref.stiffness"], [], "it is no number of this scene"),
        ("x", ["friction.slide"], ["friction.slide=0"], "take a place farther from its end"),
        ("x", ["push"], ["push=1,2", "speed=0,1", "depth=0,1"], "a map has two axes"),
        ("x", ["push"], ["cone=elliptic,pyramidal"], "must be numeric"),
    ],
)
def test_mistakes_are_told_before_anything_runs(
    tmp_path: Path, of: str, by: list[str], assign: list[str], said: str
) -> None:
    request = GradientsRequest(str(GRADIENTS / "push"), of, by, assign)
    with pytest.raises(SweepFileError, match=said):
        differentiate_scene(request, Session(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "of", "by", "values"),
    [
        ("ball", "x.v", "speed", {"speed": 6.0}),
        ("ball", "x.v", "speed", {"speed": 6.0, "solref.damping": 0.0}),
        ("push", "x", "push", {}),
    ],
    ids=["ball", "elastic", "push"],
)
def test_automatic_differentiation_is_the_runs_own(
    name: str, of: str, by: str, values: Values
) -> None:
    """MJX differentiates the steps that it makes, in double precision: their own derivative.

    The ball's run of .2 s meets the wall after .17 s; both step alike to 1e-14, and a solver of one
    contact converges. Where nothing damps the ball, and where the push begins, there is no force
    along the contact, of whose square MJX takes the root.
    """
    if not engine().version:
        pytest.skip("mjx is not installed: contactlab parity --install mjx")
    subject = replace(subject_of(name, of), duration=0.2)
    how = Differentiation(subject, 2, METHODS["mjx"], ladder=False)
    (found,) = how.by(subject.find_parameter(by), [Point(values, {})])
    assert found.run.value is not None
    assert found.methods["mjx"] == pytest.approx(found.run.value, rel=1e-4)


@pytest.mark.night
def test_substeps_that_end_where_a_contact_is_made_have_restitutions_derivative() -> None:
    """The run's derivative of the same ball is -7.4, for the -.6 of its model.

    Substeps s of first order damp a spring of frequency w and damping ratio z otherwise by a share
    of w s, s being such that s^2 w^2 v / 4 is the accuracy times 1 + v: 2e-4 s, w s = .02 at 1e-4.
    """
    if not engine().version:
        pytest.skip("mjx is not installed: contactlab parity --install mjx")
    subject = replace(subject_of("ball", "x.v"), duration=0.2)
    how = Differentiation(subject, 2, METHODS["mjx-adaptive"], ladder=False)
    (found,) = how.by(subject.find_parameter("speed"), [Point({"speed": 6.0}, {})])
    assert found.methods["mjx-adaptive"] == pytest.approx(-rebound(4e4, 72.35), rel=0.02)
    assert found.run.value is not None
    assert abs(found.run.value) > 7


def test_an_engine_that_is_not_here_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for means in ("mjx", "mjx-adaptive"):
        request = GradientsRequest(str(GRADIENTS / "push"), "x", ["push"], include=[means])
        with pytest.raises(EngineError, match="contactlab parity --install mjx"):
            differentiate_scene(request, Session(tmp_path / "out"))
