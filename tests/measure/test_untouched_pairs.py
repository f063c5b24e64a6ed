"""Pairs that never touch are measured once for all of them, as each would be by itself."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Trace
from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs, context
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene

# Two towers, of which the second leans; a plate that nothing touches, and one on the floor.
PLACES = {"a": (0, 0.05), "b": (0, 0.15), "c": (0.5, 0.05), "d": (0.56, 0.152), "e": (2, 1.0)}


def write_towers(folder: Path) -> Scene:
    """Return a scene of the towers that monitors each geom with each."""
    bodies = "".join(
        f'<body pos="{x} 0 {z}"><freejoint/><geom name="{name}" type="box" mass="{1 + x}" '
        f'size=".05 .05 {0.05 if x < 2 else 0.001}"/></body>'
        for name, (x, z) in PLACES.items()
    )
    floor = '<geom name="floor" type="plane" size="5 5 .1"/>'
    pairs = itertools.combinations(["floor", *PLACES], 2)
    listed = ", ".join(f"{{geoms: [{one}, {other}]}}" for one, other in pairs)
    model = f"<mujoco><worldbody>{floor}{bodies}</worldbody></mujoco>"
    (folder / "scene.xml").write_text(model, encoding="utf-8")
    head = "version: 1\ntitle: Towers\ndescription: Two towers\nduration: 0.3\n"
    (folder / "scene.yaml").write_text(f"{head}pairs: [{listed}]\n", encoding="utf-8")
    return Scene.open(str(folder))


def one_by_one(trace: Trace) -> tuple[list[int], np.ndarray]:
    """Return rows of which no pair stands for another."""
    every = range(len(trace.pairs))
    return [*every], np.array(every)


@pytest.mark.parametrize("thresholds", [{}, {"pierced": 1e-5, "mode_switches": 0.0}], ids=str)
def test_one_stands_for_all(
    thresholds: dict[str, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = write_towers(tmp_path)
    resolved = [scene.resolve(each, 0, 0.3) for each in ({}, {"solref": (0.1, 1)})]
    runs = PreparedRuns.of(scene, *resolved)
    trace = make_trace(runs.base, runs.prepared, MujocoEngine().roll_out(runs, Buffers()))
    setup = make_setup(runs.base, scene.source.manifest, resolved, runs.models, thresholds)
    untouched = sum(not pair.found.any() for pair in trace.pairs)
    assert 8 < untouched < len(trace.pairs) - 3
    for checks in (None, MujocoEngine().check_runs(runs, trace)):
        together = assess_runs(trace, setup, checks)
        with monkeypatch.context() as patch:
            patch.setattr(context, "rows_of", one_by_one)
            apart = assess_runs(trace, setup, checks)
        assert together.labels == apart.labels
        assert together.coverage == apart.coverage
        assert together.suspect.tolist() == apart.suspect.tolist()
        for key, value in apart.metrics.items():
            assert together.metrics[key].tobytes() == value.tobytes(), key
        for one, other in zip(together.series, apart.series, strict=True):
            for name, value in vars(other).items():
                same = getattr(one, name)
                assert same == value if name == "name" else same.tobytes() == value.tobytes()
