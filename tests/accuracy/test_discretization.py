"""Errors against a reference, from real sweeps: orders, references, chaos, and missing values."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow.parquet as pq
import pytest

from contactlab.accuracy import discretization
from contactlab.errors import SweepFileError
from contactlab.schema.evidence import Accuracy
from contactlab.store.finished_store import Store

Rows = list[dict[str, Any]]

SMOOTH = """
version: 1
scene: {scene}
duration: {duration}
axes:
  integrator: [Euler, RK4]
  timestep: {timesteps}
trace: none
checks: none
accuracy: {accuracy}
"""
# What moves, for how long, and the shortest step: the longest is four times as long. The box turns
# by 5 rad/s, the pendulum swings at 7 rad/s and whips round faster.
# Before MuJoCo 4.0, RK4 put its stages of a rotation together with an error of second order.
RK4_TURNING = 4 if int(mujoco.__version__.partition(".")[0]) >= 4 else 2
ORDERS = {"tumbling_box": RK4_TURNING, "double_pendulum": 4}
MOTIONS = {"tumbling_box": (2.0, 4e-3), "double_pendulum": (1.0, 5e-4)}


def smooth(scene: str, accuracy: str, *, even: bool = True) -> str:
    """Return a sweep of a scene without contact; if not even, no step divides another."""
    duration, least = MOTIONS[scene]
    timesteps = (
        str([least, 2 * least, 4 * least]) if even else f"{{logspace: [{least}, {4 * least}, 6]}}"
    )
    return SMOOTH.format(scene=scene, duration=duration, timesteps=timesteps, accuracy=accuracy)


@pytest.fixture(scope="module")
def orders(make_sweeper: Any, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Rows]:
    """Return a runner of sweeps that runs each text once."""
    known: dict[str, Rows] = {}

    def run(text: str) -> Rows:
        if text not in known:
            sweeper = make_sweeper(tmp_path_factory.mktemp("orders"))
            sweeper.run(text)
            known[text] = sweeper.rows()
        return known[text]

    return run


def slope(found: Rows, column: str, **picked: object) -> float:
    """The slope of log error against log timestep, by least squares."""
    mine = [row for row in found if all(row[name] == each for name, each in picked.items())]
    assert len(mine) >= 3
    points = np.log([(row["timestep"], row[column]) for row in mine])
    return float(np.polyfit(points[:, 0], points[:, 1], 1)[0])


@pytest.mark.night
@pytest.mark.parametrize("even", [True, False], ids=["even", "uneven"])
@pytest.mark.parametrize("scene", MOTIONS)
@pytest.mark.parametrize("column", ["error_final", "error_mean", "error_peak"])
def test_smooth_motion_converges_as_theory_says(
    orders: Callable[[str], Rows], scene: str, column: str, *, even: bool
) -> None:
    """First order for the semi-implicit Euler step, fourth for RK4; fitted within 0.2.

    Terms of the next order are smaller by the timestep times the rate of the motion, 16 ms * 5/s
    or 2 ms * 20/s: they bend a slope by less than a tenth.
    """
    found = orders(smooth(scene, "{error: trajectory}", even=even))
    assert slope(found, column, integrator="Euler") == pytest.approx(1, abs=0.2)
    assert slope(found, column, integrator="RK4") == pytest.approx(ORDERS[scene], abs=0.2)
    assert all(row["error_final_estimate"] < 0.1 * row["error_final"] for row in found)
    assert {row["impacts"] for row in found} == {0}
    assert {row["chaotic"] for row in found} == {False}


@pytest.mark.night
@pytest.mark.parametrize("scene", MOTIONS)
def test_local_errors_converge_as_well(orders: Callable[[str], Rows], scene: str) -> None:
    """Restarts last equally long at every timestep, so that errors fall with the same order."""
    found = orders(smooth(scene, "{error: local}"))
    assert slope(found, "error_mean", integrator="Euler") == pytest.approx(1, abs=0.2)
    assert slope(found, "error_mean", integrator="RK4") == pytest.approx(ORDERS[scene], abs=0.2)
    whole = orders(smooth(scene, "{error: trajectory}"))
    for short, long in zip(found, whole, strict=True):
        assert short["error_kind"] == "local"
        assert short["error_mean"] < long["error_peak"]


@pytest.mark.long
def test_a_finer_reference_moves_errors_by_less_than_the_estimate(
    orders: Callable[[str], Rows],
) -> None:
    """What the estimate bounds: how far the reference is from one that is four times finer."""
    coarse = orders(smooth("double_pendulum", "{error: trajectory, refine: 2}"))
    fine = orders(smooth("double_pendulum", "{error: trajectory, refine: 8}"))
    for one, other in zip(coarse, fine, strict=True):
        for name in ("final", "mean"):
            apart = abs(one[f"error_{name}"] - other[f"error_{name}"])
            assert apart <= one[f"error_{name}_estimate"]
        assert abs(one["error_peak"] - other["error_peak"]) <= one["error_estimate"]
        assert one["error_estimate"] > other["error_estimate"]


@pytest.mark.long
def test_many_timesteps_share_the_memory_of_a_reference(
    sweeper: Any, orders: Callable[[str], Rows], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With 16 common times instead of 256 the end is the same, the mean one of a rough sum.

    The error grows like the sixth power of time, of which 16 samples at the ends of equal parts
    give a mean that is too large by 7/(2 * 16).
    """
    text = smooth("tumbling_box", "{error: trajectory}")
    usual = orders(text)
    monkeypatch.setattr(discretization, "_MOST_BYTES_OF_STATES", 1)
    sweeper.run(text)
    for few, many in zip(sweeper.rows(), usual, strict=True):
        assert few["error_final"] == pytest.approx(many["error_final"], rel=1e-6)
        assert many["error_mean"] < few["error_mean"] < 1.22 * many["error_mean"]


def test_one_reference_for_numerics_another_for_each_model(sweeper: Any) -> None:
    """Two timesteps share it; it is finer than the least of them by refine, and then by two."""
    sweeper.run(
        "version: 1\nscene: ball_drop\nduration: 0.1\ntrace: none\nchecks: none\n"
        "axes: {timestep: [1.0e-3, 4.0e-3], solver: [Newton, CG], drop_height: [0.01, 0.02]}\n"
        "accuracy: {refine: 4}\n"
    )
    found = sweeper.rows()
    assert {row["reference_timestep"] for row in found} == {1e-3 / 4 / 2}
    by_height = {
        height: {row["error_estimate"] for row in found if row["drop_height"] == height}
        for height in (0.01, 0.02)
    }
    assert [len(estimates) for estimates in by_height.values()] == [1, 1]
    assert by_height[0.01] != by_height[0.02]


def test_a_free_fall_has_the_error_of_its_closed_form(sweeper: Any) -> None:
    """Euler's speed g t is exact, and its place is off by g t h / 2."""
    sweeper.run(
        "version: 1\nscene: ball_drop\nduration: 0.1\ntrace: none\nchecks: none\n"
        "axes: {integrator: [Euler], timestep: [1.0e-3, 4.0e-3], drop_height: [1.0]}\n"
        "accuracy: {error: trajectory}\n"
    )
    for row in sweeper.rows():
        # A hundred sums of numbers up to 1 m/s.
        assert row["error_velocity"] == pytest.approx(0, abs=1e-13)
        # The reference is of fourth order, and exact where the acceleration is constant.
        assert row["error_final"] == pytest.approx(9.81 * 0.1 * row["timestep"] / 2, rel=1e-9)


CHAOS = """
version: 1
scene: double_pendulum
duration: {duration}
axes: {{integrator: [RK4, Euler], timestep: [4.0e-3, 8.0e-3]}}
trace: none
checks: none
accuracy: {{error: {error}, refine: 8}}
"""


@pytest.mark.long
def test_chaos_is_recognised_by_a_perturbed_copy(sweeper: Any) -> None:
    """Ten seconds of swinging from 120 degrees part what was 1e-8 apart; one second does not."""
    sweeper.run(CHAOS.format(duration=10.0, error="auto"), "long")
    sweeper.run(CHAOS.format(duration=1.0, error="auto"), "short")
    long, short = sweeper.rows("long"), sweeper.rows("short")
    assert {(row["chaotic"], row["error_kind"]) for row in long} == {(True, "invariants")}
    assert {(row["chaotic"], row["error_kind"]) for row in short} == {(False, "trajectory")}
    assert unit(sweeper.folder / "long") == "1"
    assert unit(sweeper.folder / "short") == "m"
    errors = {(row["integrator"], row["timestep"]): row["error_final"] for row in long}
    assert errors["RK4", 4e-3] < 0.1 * errors["Euler", 4e-3], "RK4 keeps the energy"


@pytest.mark.long
def test_a_scene_may_be_declared_chaotic_or_not(sweeper: Any) -> None:
    sweeper.run(CHAOS.format(duration=10.0, error="trajectory"), "path")
    sweeper.run(CHAOS.format(duration=1.0, error="invariants"), "kept")
    path, kept = sweeper.rows("path"), sweeper.rows("kept")
    assert {(row["chaotic"], row["error_kind"]) for row in path} == {(True, "trajectory")}
    assert {(row["chaotic"], row["error_kind"]) for row in kept} == {(False, "invariants")}
    drifts = [row["energy_drift"] for row in kept]
    # The metric takes a run's own kinetic energy and the start; the error the reference's.
    for row, drift in zip(kept, drifts, strict=True):
        assert row["error_final"] == pytest.approx(abs(drift), rel=0.1, abs=1e-6)


def unit(store: Path) -> str:
    metadata = pq.read_schema(store / "runs.parquet").field("error_final").metadata
    return metadata[b"unit"].decode()


def test_solref_clamped_by_refsafe_is_reported(sweeper: Any) -> None:
    """A time constant of 20 ms is raised from 10 ms on, but not in direct form."""
    sweeper.run(
        "version: 1\nscene: ball_drop\nduration: 0.2\ntrace: none\nchecks: none\n"
        "axes:\n  timestep: [5.0e-3, 1.25e-2]\n  solref: ['0.02 1', '-2500 -100']\n"
        "  drop_height: [0.05]\naccuracy: {refine: 2}\n"
    )
    found = {(row["timestep"], row["solref"]): row for row in sweeper.rows()}
    clamped = {key for key, row in found.items() if row["solref_clamped"]}
    assert clamped == {(1.25e-2, "0.02 1")}
    assert {row["solref_rule"] for row in found.values()} == {"absolute"}
    assert all(row["impacts"] > 0 for row in found.values())


def test_impacts_are_counted_with_local_errors(sweeper: Any) -> None:
    """The ball falls 50 mm in 0.1 s; one step cannot show it, the run does."""
    sweeper.run(
        "version: 1\nscene: ball_drop\nduration: 0.2\ntrace: none\nchecks: none\n"
        "axes: {timestep: [2.0e-3, 1.0e-2], drop_height: [0.05]}\n"
        "accuracy: {error: local, refine: 2}\n"
    )
    assert all(row["impacts"] > 0 for row in sweeper.rows())


@pytest.mark.parametrize(
    ("constants", "rule"), [("4.0e-3, 8.0e-3", "tied"), ("4.0e-3, 5.0e-3", "absolute")]
)
def test_solref_may_follow_the_timestep(sweeper: Any, constants: str, rule: str) -> None:
    sweeper.run(
        "version: 1\nscene: ball_drop\nduration: 0.05\ntrace: none\nchecks: none\n"
        f"zip:\n  - {{timestep: [1.0e-3, 2.0e-3], solref.timeconst: [{constants}]}}\n"
        "accuracy: {refine: 2}\n"
    )
    assert [row["solref_rule"] for row in sweeper.rows()] == [rule, rule]
    assert len({row["reference_timestep"] for row in sweeper.rows()}) == 2, "two models"


def test_a_run_that_does_not_complete_has_no_error(sweeper: Any) -> None:
    """Euler's top ends in bad accelerations; its family and the impulse engine go on without."""
    sweeper.run(
        "version: 1\nscene: heavy_top\nduration: 3.0\ntrace: none\nchecks: none\n"
        "axes: {integrator: [RK4, Euler], timestep: [2.0e-3]}\naccuracy: {refine: 2}\n"
    )
    rk4, euler = sweeper.rows()
    assert euler["status"] == "stopped"
    assert (euler["error_final"], euler["impacts"], euler["chaotic"]) == (None, None, None)
    assert euler["error_kind"] == rk4["error_kind"] == "trajectory"
    assert rk4["error_final"] > rk4["error_final_estimate"] > 0


@pytest.mark.long
def test_the_impulse_engine_has_no_reference(sweeper: Any) -> None:
    sweeper.run(
        "version: 1\nscene: ball_drop\nduration: 0.1\ntrace: none\nchecks: none\n"
        "axes: {engine: [mujoco, impulse]}\naccuracy: {refine: 2}\ntiming: {}\n"
    )
    mujoco, impulse = sweeper.rows()
    assert mujoco["error_final"] is not None
    assert mujoco["time_min"] is not None
    assert impulse["error_final"] is impulse["time_min"] is impulse["work_steps"] is None


def test_columns_are_null_without_passes(sweeper: Any, ball: str) -> None:
    sweeper.run(ball)
    table = pq.read_table(sweeper.folder / "store" / "runs.parquet")
    for name in Accuracy.model_fields:
        assert table[name].null_count == table.num_rows
    records = list(Store.open(sweeper.folder / "store").records())
    assert {(record.accuracy, record.timing) for record in records} == {(None, None)}


TOLERATED = """
version: 1
scene: tumbling_box
duration: 1.0
axes: {integrator: [Euler, RK4]}
trace: none
checks: none
accuracy: {refine: 2}
tolerances: {error_final: 1.0e-4%s}
"""


@pytest.mark.parametrize(("others", "met"), [("", [False, True]), (", spin_drift: 0", [False] * 2)])
def test_errors_may_be_tolerated_like_metrics(sweeper: Any, others: str, met: list[bool]) -> None:
    sweeper.run(TOLERATED % others)
    assert [row["tolerances_met"] for row in sweeper.rows()] == met


def test_errors_that_are_not_measured_cannot_be_tolerated(sweeper: Any) -> None:
    text = (TOLERATED % "").replace("accuracy: {refine: 2}\n", "")
    with pytest.raises(SweepFileError, match=r"only measured if .*requests accuracy"):
        sweeper.run(text)
