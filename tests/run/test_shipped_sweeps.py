"""The shipped sweeps, run as shipped, against physics: what must come out, and what must fail.

Symbols: w is the contact's natural frequency, h the timestep, v the speed of an impact, e the
restitution that was asked for.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab import resources
from contactlab.plan.sweep_file import read_sweep
from contactlab.run.sweep_request import SceneLoader, SweepRequest
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

Rows = list[dict[str, Any]]
GRAVITY = 9.81


@pytest.fixture(scope="module")
def rows_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Rows]:
    """Return the rows of a shipped sweep, which runs once."""
    done: dict[str, Rows] = {}

    def run(name: str) -> Rows:
        if name not in done:
            done[name] = _run(name, tmp_path_factory.mktemp(name) / "store")
        return done[name]

    return run


def _run(name: str, store: Path) -> Rows:
    path = resources.sweep_file(name)
    scenes = SceneLoader(path.parent)
    read = read_sweep(path, scenes.vocabulary)
    ask = SweepRequest(
        plan=read.plan,
        scene=scenes.open(read.sweep.scene),
        name=name,
        source=read.text,
        overrides=(),
        store=store,
        workers=2,
    )
    run_sweep(ask, begin=lambda *_: None, progress=lambda _: None)
    return Store.open(store).table.to_pylist()


def pick(rows: Rows, **values: object) -> Rows:
    picked = [row for row in rows if all(row[name] == value for name, value in values.items())]
    assert picked
    return picked


@pytest.mark.long
@pytest.mark.parametrize("name", ["bounce", "slide", "stack"])
def test_everything_expected_comes_out(rows_of: Callable[[str], Rows], name: str) -> None:
    rows = rows_of(name)
    assert {row["status"] for row in rows} == {"ok"}
    assert {row["expectation_met"] for row in rows} <= {True, None}
    assert True in {row["expectation_met"] for row in rows}


@pytest.mark.parametrize(
    ("asked", "least", "most"),
    [
        # Where in a step an impact begins spreads e; at w h = 0.2 from 0.148 to 0.209 for 0.2, from
        # 0.574 to 0.618 for 0.6 and from 0.894 to 0.910 for 0.9. A mean of impacts lies in there.
        # Gravity takes more from slow ones. For 0.2 the second impact is too slow to count, and
        # the first is of 3.1 m/s or more, where gravity takes 0.008. For 0.6 the third, of
        # 1.1 m/s or more, is the slowest that counts, where it takes 0.007; for 0.9, nothing.
        (0.2, 0.148 - 0.008, 0.209),
        (0.6, 0.574 - 0.007, 0.618),
        (0.9, 0.894, 0.910),
    ],
)
@pytest.mark.long
def test_a_short_step_bounces_as_asked(
    rows_of: Callable[[str], Rows], asked: float, least: float, most: float
) -> None:
    for row in pick(rows_of("bounce"), timestep=5e-4, restitution=asked):
        assert least <= row["restitution_measured"] <= most
        assert row["energy_gain"] < 0.01


@pytest.mark.long
def test_a_long_step_tunnels_or_gains_energy(rows_of: Callable[[str], Rows]) -> None:
    """A ball that falls 2 m moves 125 mm in a step of 20 ms; its radius is 50 mm."""
    for row in pick(rows_of("bounce"), timestep=2e-2, drop_height=2.0):
        assert {"tunneling", "energy_injection"} & set(row["labels"])
        assert row["penetration_max"] > 0.05


@pytest.mark.parametrize("direction", [0.0, 22.5, 45.0])
def test_an_elliptic_cone_stops_a_box_alike_in_every_direction(
    rows_of: Callable[[str], Rows], direction: float
) -> None:
    """D = v^2 / (2 mu g) - v h / 2, with v = 2 m/s, mu = 0.5 and h = 2 ms."""
    distance = 2.0**2 / (2 * 0.5 * GRAVITY) - 2.0 * 2e-3 / 2
    (row,) = pick(rows_of("slide"), cone="elliptic", direction=direction)
    assert row["oracle_measured"] == pytest.approx(distance, rel=0.01)
    assert row["mode_switches"] * row["duration"] == pytest.approx(1)


def test_a_pyramidal_cone_is_weak_off_its_axes(rows_of: Callable[[str], Rows]) -> None:
    """Its bound is on |f1| + |f2|: at 45 degrees friction is weaker by sqrt 2."""
    (along,) = pick(rows_of("slide"), cone="pyramidal", direction=0.0)
    (across,) = pick(rows_of("slide"), cone="pyramidal", direction=45.0)
    assert along["label"] == "stable"
    assert across["label"] == "oracle_miss"
    ratio = across["oracle_measured"] / along["oracle_measured"]
    assert ratio == pytest.approx(2**0.5, rel=0.01)


@pytest.mark.long
def test_a_stack_sags_by_what_its_contacts_yield(rows_of: Callable[[str], Rows]) -> None:
    """The fixed point r = F A (1 - d) (dw tc dr)^2 / d^2, summed over ten contacts: 6.1008 mm."""
    for row in pick(rows_of("stack"), boxes=10):
        assert row["oracle_measured"] == pytest.approx(6.1008e-3, rel=0.01)
        assert row["label"] == "stable"
