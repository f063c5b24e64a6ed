"""Measures of chaotic motion allow what an equal motion has by chance, and not much more."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contactlab.budget import Motion
from contactlab.studies.verification.panel import LABEL_CHANCE, exceeds_chance
from contactlab.studies.verification.run_measures import (
    CHANCE,
    compare_run,
    find_chaotic_bodies,
    find_unresolved_bodies,
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


@pytest.mark.parametrize("before", [0, 1, 5])
def test_labels_of_many_runs_are_compared_by_fishers_test(before: int) -> None:
    """Against all tables of the same margins, counted one by one."""
    for after in range(before, 17):
        shuffled = [
            math.comb(16, other) * math.comb(16, before + after - other)
            for other in range(17)
            if 0 <= before + after - other <= 16
        ]
        tail = [
            math.comb(16, other) * math.comb(16, before + after - other)
            for other in range(after, 17)
            if 0 <= before + after - other <= 16
        ]
        assert exceeds_chance(before, after, 16) == (sum(tail) / sum(shuffled) < LABEL_CHANCE)
    assert not exceeds_chance(0, 2, 16)
    assert exceeds_chance(0, 3, 16)


def test_bodies_of_a_chaotic_task_are_found(tmp_path: Path) -> None:
    """The dice end elsewhere after a nudge; a box that rests next to them does not."""
    beside = (
        '<body pos="1 1 .03"><freejoint/><geom type="box" size=".1 .1 .03"/></body></worldbody>'
    )
    path = tmp_path / "dice.xml"
    path.write_text(DICE.replace("</worldbody>", beside))
    motion = open_model(str(path), Session(tmp_path / "results")).motions[0]
    found = find_chaotic_bodies(motion, 1)
    assert found[:3].any()
    assert not found[3]


def test_a_nudge_moves_free_bodies_against_each_other(tmp_path: Path) -> None:
    """The same nudge of all spheres would only shift their heap on the floor."""
    body = '<body pos="{x} 0 {z}"><freejoint/><geom size=".04"/></body>'
    heap = "".join(body.format(x=0.003 * (each % 3), z=0.05 + 0.09 * each) for each in range(8))
    floor = '<geom type="plane" size="5 5 .1"/>'
    path = tmp_path / "heap.xml"
    path.write_text(f"<mujoco><worldbody>{floor}{heap}</worldbody></mujoco>")
    motion = open_model(str(path), Session(tmp_path / "results")).motions[0]
    nudges = (nudge_start(motion).starts - motion.starts)[0]
    nudges = nudges[nudges != 0].reshape(8, 6)
    assert len({tuple(np.sign(each)) for each in nudges}) > 1
    assert find_chaotic_bodies(motion, 1).any()


def test_ends_that_no_step_resolves_are_left_out(tmp_path: Path) -> None:
    """The dice end elsewhere at any finer step; a box that slides to rest on a plane does not."""
    box = '<geom type="box" size=".1 .1 .03"/></body></worldbody>'
    slides = f'<body pos="1 1 .03"><joint type="slide" axis="1 0 0"/>{box}'
    path = tmp_path / "dice.xml"
    path.write_text(DICE.replace("</worldbody>", slides))
    motion = open_model(str(path), Session(tmp_path / "results")).motions[0]
    run = pair_motions("fall", motion, motion)
    found = find_unresolved_bodies(run, tabulate_run(run, 1, {}), 1)
    assert found[:3].any()
    assert not found[3]
