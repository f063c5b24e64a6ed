"""Orders of convergence come out as theory has them where the motion is smooth, else not at all."""

from collections.abc import Callable

import mujoco
import pytest

from contactlab.pareto.analysis import analyze_tradeoff
from contactlab.pareto.criteria import Criteria
from contactlab.schema.tradeoff_report import Order
from contactlab.store.finished_store import Store

# Before MuJoCo 4.0, RK4 put its stages of a rotation together with an error of second order.
RK4_TURNING = 4 if int(mujoco.__version__.partition(".")[0]) >= 4 else 2
Written = Callable[..., Store]
SMOOTH = """
version: 1
scene: {scene}
duration: {duration}
axes:
  timestep: {{logspace: [5.0e-4, 8.0e-3, 5]}}
  integrator: [Euler, RK4]
accuracy: {{error: trajectory}}
trace: none
checks: none
"""
BOUNCING = """
version: 1
scene: ball_drop
duration: 1.0
axes:
  timestep: [2.5e-4, 5.0e-4, 1.0e-3, 2.0e-3]
  integrator: [Euler, RK4]
accuracy: {error: trajectory}
trace: none
checks: none
"""


def orders(store: Store) -> dict[object, Order]:
    report = analyze_tradeoff(store, Criteria(metric="error_final"))
    return {each.configuration["integrator"]: each.order for each in report.methods}


@pytest.mark.night
@pytest.mark.parametrize(
    ("scene", "duration", "rk4"), [("double_pendulum", 0.5, 4), ("tumbling_box", 2.0, RK4_TURNING)]
)
def test_euler_is_of_first_and_rk4_of_fourth_order(
    written: Written, scene: str, duration: float, rk4: int
) -> None:
    found = orders(written(SMOOTH.format(scene=scene, duration=duration)))
    assert found["Euler"].slope == pytest.approx(1, abs=0.2)
    assert found["RK4"].slope == pytest.approx(rk4, abs=0.2)
    assert min(each.points for each in found.values()) >= 3


@pytest.mark.night
def test_across_impacts_there_is_no_order(written: Written) -> None:
    for order in orders(written(BOUNCING)).values():
        assert order.slope is None
        assert "impacts" in str(order.reason)
