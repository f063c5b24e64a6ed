"""Measures of chaotic motion allow what an equal motion has by chance, and not much more."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.studies.verification.run_measures import (
    CHANCE,
    compare_run,
    largest_by_chance,
    tabulate_run,
)
from contactlab.studies.verification.runs import nudge_start, pair_motions
from contactlab.tasks.checked_model import open_model
from contactlab.tasks.session import Session

DICE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="2 2 .1"/>
    <body pos="0 0 .2" euler="20 30 0"><freejoint/><geom type="box" size=".03 .03 .03"/></body>
    <body pos=".01 0 .3" euler="50 10 0"><freejoint/><geom type="box" size=".03 .03 .03"/></body>
    <body pos="0 .01 .4" euler="70 40 0"><freejoint/><geom type="box" size=".03 .03 .03"/></body>
  </worldbody>
</mujoco>
"""
"""Three boxes fall on each other, and end in other places after any nudge."""


def _deepest(folder: Path, changed_text: str, nudges: int) -> dict[str, bool]:
    motions = list[Motion]()
    for name, text in (("original", DICE), ("changed", changed_text)):
        path = folder / name / "dice.xml"
        path.parent.mkdir(parents=True)
        path.write_text(text)
        motions.append(open_model(str(path), Session(path.parent / "results")).motions[0])
    original, changed = motions
    for _ in range(nudges):
        changed = nudge_start(changed)
    run = replace(pair_motions("fall", original, changed, at_rest=True), passive=True)
    found = compare_run(run, tabulate_run(run, 1, {}), 0.0, keeps_motion=False)
    return {measure.name: measure.worse for measure in found}


@pytest.mark.parametrize(
    "nudges", [3, *(pytest.param(count, marks=pytest.mark.long) for count in (10, 40))]
)
def test_an_equal_motion_is_not_worse(tmp_path: Path, nudges: int) -> None:
    found = _deepest(tmp_path, DICE, nudges)
    assert {"depth", "creep", "energy gain"} & {*found}
    assert not any(found.values())


def test_soft_contacts_are_worse_in_chaotic_motion(tmp_path: Path) -> None:
    soft = DICE.replace("<worldbody>", '<default><geom solref="0.2 1"/></default><worldbody>')
    assert _deepest(tmp_path, soft, 0)["depth"]


@pytest.mark.parametrize("seeds", [1, 3, 5])
def test_chance_exceeds_the_bound_as_often_as_stated(seeds: int) -> None:
    """20,000 equal motions: the share beyond the bound is that of the stated probability."""
    generator = np.random.default_rng(seeds)
    count = 20_000
    drawn = generator.normal(3.0, 0.5, size=(4, seeds, count))
    bound = largest_by_chance([drawn[0], drawn[1], drawn[2], drawn[3]])
    share = float(np.mean(drawn[1].mean(axis=0) > bound))
    deviation = np.sqrt(CHANCE * (1 - CHANCE) / count)
    assert share == pytest.approx(CHANCE, abs=4 * deviation)
