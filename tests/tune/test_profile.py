"""Shares of time, from a clock that charges a planted price for every part."""

from dataclasses import dataclass

import mujoco
import pytest

from contactlab.engines import engine_of
from contactlab.engines.engine import Segments, TimesSteps
from contactlab.scene.scene import Scene
from contactlab.studies.tune.profile import PARTS, costs_without

PRICES = {"sensors": 3.0, "contacts": 5.0, "constraints, contacts included": 7.0}
REST = 4.0
_OFF = mujoco.mjtDisableBit


@dataclass
class Till:
    """Charges for what a model has on; where prices rise, they do so after each round of 12."""

    inflation: float = 1.0
    charged: int = 0

    def __call__(self, segments: Segments, most: int, repeats: int) -> tuple[float, int]:
        flags = segments.model.opt.disableflags
        price = REST
        price += PRICES["sensors"] * (not flags & _OFF.mjDSBL_SENSOR)
        if not flags & _OFF.mjDSBL_CONSTRAINT:
            price += PRICES["constraints, contacts included"]
            price -= PRICES["contacts"] * bool(flags & _OFF.mjDSBL_CONTACT)
        price += segments.model.opt.iterations / 100 + segments.model.opt.noslip_iterations
        rounds, self.charged = self.charged // 12, self.charged + 1
        return price * self.inflation**rounds, most * repeats


@pytest.fixture(scope="module")
def run() -> Segments:
    scene = Scene.open("box_stack")
    resolved = scene.resolve({}, 0, 0.1)
    start = scene.starts([resolved])
    model = scene.prepare(resolved, start, scene.compile_without_sensors(resolved)).model
    engine = engine_of(resolved)
    assert isinstance(engine, TimesSteps)
    work = engine.count_work(model, start, resolved.steps)
    assert work is not None
    return Segments(model, start, work)


@pytest.mark.parametrize("inflation", [1.0, 1.5])
def test_shares_are_the_planted_prices(run: Segments, inflation: float) -> None:
    """All take turns, so that a machine that slows down changes no ratio."""
    whole = REST + PRICES["sensors"] + PRICES["constraints, contacts included"]
    whole += run.model.opt.iterations / 100
    found = costs_without([run, run], Till(inflation), rounds=3)
    assert list(found) == [*PARTS]
    for name, price in PRICES.items():
        assert 1 - found[name].ratio == pytest.approx(price / whole, rel=1e-12)
    assert found["the integrator, over Euler"].ratio == 1
    for each in found.values():
        assert each.pairs == 3
        assert each.low == pytest.approx(each.high, rel=1e-12)


def test_the_whole_model_stays_as_it_is(run: Segments) -> None:
    before = run.model.opt.disableflags, run.model.opt.iterations, run.model.opt.integrator
    costs_without([run], Till(), rounds=1)
    after = run.model.opt.disableflags, run.model.opt.iterations, run.model.opt.integrator
    assert before == after


def test_the_engine_steps_a_model_without_any_part(run: Segments) -> None:
    """Every variant goes through from the states of the whole, and takes some time."""
    resolved = Scene.open("box_stack").resolve({}, 0, 0.1)
    engine = engine_of(resolved)
    assert isinstance(engine, TimesSteps)
    found = costs_without([run], engine.time_segments, rounds=1)
    assert all(each.low > 0 for each in found.values())
