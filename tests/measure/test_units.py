"""What is said of a model is the same in metres and kilograms, and in millimetres and grams."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.measure.units import rescaled

import contactlab
from contactlab.measure import METRICS
from contactlab.resources import MODELS
from contactlab.schema.examination import Examination

# Powers of length and of mass that a metric's unit has.
_POWERS = {"m": (1, 0), "m/s": (1, 0), "N s": (1, 1), "J": (2, 1)}
# On a slope a slab sinks in, a grain creeps, and a box hammers.
_SLOPE = """<mujoco><option timestep=".002" gravity="3 0 -9.2"/><worldbody>
    <geom name="slope" type="plane" size="0 0 1" friction=".4"/>
    <body name="slab" pos="1 0 .004"><freejoint/>
    <geom type="box" size=".05 .05 .004" mass=".1" solref=".3 1" solmix="1e6"/></body>
    <body name="grain" pos="0 0 .001"><freejoint/>
    <geom type="box" size=".001 .001 .001" mass="1e-5" friction=".4"/></body>
    <body name="box" pos="0 1 .0502"><freejoint/>
    <geom type="box" size=".05 .05 .05" mass="1" solref="-200000 -1" priority="1"/></body>
    </worldbody></mujoco>"""
_LABELS = {"deep_penetration", "creep"}


def judged(text: str, file: Path) -> tuple[set[str], dict[str, float | None]]:
    """Return the labels of a run and its metrics."""
    file.write_text(text, encoding="utf-8")
    wanted = {"version": 1, "scene": str(file), "duration": 0.4, "trace": "none", "checks": "all"}
    store = contactlab.sweep(wanted, output=file.with_suffix(""), drive="none", workers=0)
    table = store.table
    names = [name for name in METRICS if name in table.column_names]
    return {*table["labels"][0].as_py()}, {name: table[name][0].as_py() for name in names}


def test_labels_and_shares_are_the_same_in_any_unit(tmp_path: Path) -> None:
    """Forces scale exactly but for rounding, of which this run makes a thousandth at most."""
    length, mass = 1000.0, 1000.0
    labels, values = judged(rescaled(_SLOPE, 1, 1), tmp_path / "one.xml")
    same, others = judged(rescaled(_SLOPE, length, mass), tmp_path / "other.xml")
    assert labels == same
    assert labels >= _LABELS
    for name, value in values.items():
        long, heavy = _POWERS.get(METRICS[name].unit, (0, 0))
        if METRICS[name].kind != "work" and METRICS[name].unit != "any" and value is not None:
            expected = value * length**long * mass**heavy
            assert others[name] == pytest.approx(expected, rel=1e-3, abs=1e-6), name


def speeds(report: Examination) -> Iterator[float]:
    """Yield the speeds of the rows that matter."""
    assert report.budget
    for phase in report.budget.phases:
        for row in phase.rows:
            if row.speed is not None and (row.error or 0.0) > report.budget.tolerance:
                yield row.speed


@pytest.mark.night
@pytest.mark.parametrize("scene", ["box_stack", "elastic_bounce", "newtons_cradle"])
def test_an_examination_says_the_same_in_any_unit(scene: str, tmp_path: Path) -> None:
    """But for speeds, which are numbers of the model's own length: nothing in it says of which.

    Units that are powers of 2 scale every number exactly, so that engines keep each bit of a run.
    By others rounding tells whether boxes that lie flush touch at the start, in 28 or 40 points. A
    seed's .1 mm is no length of the model, and is 1e-4 of it here.
    """
    text = (MODELS / scene / "scene.xml").read_text(encoding="utf-8")
    said = []
    for place, unit in enumerate([(1.0, 1.0), (1024.0, 1024.0)]):
        file = tmp_path / f"model{place}.xml"
        file.write_text(rescaled(text, *unit), encoding="utf-8")
        said.append(
            contactlab.examine(file, section=("labels", "budget"), duration="0.5 s", workers=1)
        )
    one, other = said
    assert one.headline == other.headline
    slow, fast = (np.array([*speeds(each)]) for each in said)
    assert len(slow)
    np.testing.assert_allclose(fast, 1024 * slow, rtol=0.02)
    assert [label.label for label in one.labels] == [label.label for label in other.labels]
    assert one.budget
    assert other.budget
    for phase, same in zip(one.budget.phases, other.budget.phases, strict=True):
        np.testing.assert_allclose(phase.run.share, same.run.share, rtol=1e-3, atol=1e-9)
