"""Scenes against their closed forms."""

from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_setup import FreeBody
from contactlab.errors import SceneError
from contactlab.measure import ORACLES, assess_runs

SOLREF, SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)


def found(trace: Any, setup: Any) -> list[float]:
    metrics = assess_runs(trace, setup).metrics
    return [metrics[f"oracle_{part}"][0] for part in ("expected", "measured", "error")]


def labels(trace: Any, setup: Any) -> list[str]:
    return [outcome.label for outcome in assess_runs(trace, setup).labels[0]]


def test_every_oracle_says_what_it_is() -> None:
    for name, oracle in ORACLES.items():
        assert oracle.name == name
        assert oracle.definition.endswith(".")
        assert oracle.settings
        assert oracle.unit


def test_scenes_without_oracle_have_none(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of()
    assert np.isnan(found(trace, setup_of(trace))).all()
    with pytest.raises(SceneError, match="did you mean 'stack_sag'"):
        assess_runs(trace, setup_of(trace, oracle="stacksag"))


@pytest.mark.parametrize(("integrator", "bias"), [("Euler", 0.5), ("RK4", 0.0)])
def test_sliding_distance(trace_of: Any, setup_of: Any, integrator: str, bias: float) -> None:
    speed, mu, timestep, gravity = 2.0, 0.5, 0.01, 9.81
    settings = {
        "speed": [speed],
        "friction": [(mu, mu, 0.005, 1e-4, 1e-4)],
        "timestep": [timestep],
        "integrator": [integrator],
    }
    stop = speed**2 / (2 * mu * gravity) - bias * speed * timestep
    trace = trace_of()
    trace.qpos[0, -1, :3] = stop * 0.6, stop * 0.8, -0.3
    setup = setup_of(trace, oracle="sliding_distance", oracle_tolerance=0.01, settings=settings)
    assert found(trace, setup) == pytest.approx([stop, stop, 0], abs=1e-12)
    assert labels(trace, setup) == ["stable"]
    trace.qpos[0, -1, :2] *= 1.02
    assert found(trace, setup)[2] == pytest.approx(0.02)
    assert labels(trace, setup) == ["oracle_miss"]


def stack(pair_of: Any, trace_of: Any, setup_of: Any, masses: list[float]) -> tuple[Any, Any]:
    """A stack in which each layer is 1 mm deep."""
    pairs = tuple(
        pair_of(1, 50, slots=4, normal=1.0, distance=-1e-3, name=f"layer{k}")
        for k in range(len(masses))
    )
    trace = trace_of(1, 50, pairs=pairs)
    bodies = tuple(FreeBody(f"box{k}", 0, 0, np.array([mass])) for k, mass in enumerate(masses))
    settings = {"solref": [SOLREF], "solimp": [SOLIMP]}
    return trace, setup_of(trace, free_bodies=bodies, oracle="stack_sag", settings=settings)


def test_stack_sag_of_ten_boxes(pair_of: Any, trace_of: Any, setup_of: Any) -> None:
    # Measured with MuJoCo 4.0.0: 6.1008 mm for ten boxes, .1078 mm for one, whatever the mass.
    for mass in (1.0, 100.0):
        trace, setup = stack(pair_of, trace_of, setup_of, [mass] * 10)
        expected, measured, error = found(trace, setup)
        assert expected == pytest.approx(6.1008e-3, abs=5e-8)
        assert measured == pytest.approx(10e-3)
        assert error == pytest.approx(10 / 6.1008 - 1, rel=1e-4)
    one = found(*stack(pair_of, trace_of, setup_of, [1.0]))
    assert one[0] == pytest.approx(0.1078e-3, abs=5e-8)


def test_a_heavy_load_rests_deep(pair_of: Any, trace_of: Any, setup_of: Any) -> None:
    light = found(*stack(pair_of, trace_of, setup_of, [1.0, 1.0]))[0]
    heavy = found(*stack(pair_of, trace_of, setup_of, [1.0, 1000.0]))[0]
    # Known for 1000:1 at the engine's defaults: either side of the light box should sink by 49 mm.
    assert heavy / 2 == pytest.approx(49e-3, rel=0.02)
    assert heavy > 50 * light


def test_restitution_needs_a_bounce(trace_of: Any, setup_of: Any) -> None:
    trace = trace_of()
    setup = setup_of(
        trace,
        oracle="restitution",
        oracle_tolerance=0.05,
        settings={"solref": [(-160000.0, -145.0)]},
    )
    expected, measured, _ = found(trace, setup)
    assert expected == pytest.approx(0.6, abs=1e-3)
    assert np.isnan(measured)
    assert labels(trace, setup) == ["oracle_miss"]
