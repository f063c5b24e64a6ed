"""The ids of the runs of a row are hashes of JSON, seed by seed."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_edits import is_as_written, non_default_flags
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.run_spec import RunSpec, other_effects
from contactlab.scene.scene import Scene

Draw = Callable[[st.SearchStrategy[Any]], Any]

SCENES = {
    name: Scene.open(name) for name in ("ball_drop", "box_stack", "grasp_mug", "rolling_plate")
}
REALS = st.one_of(
    st.sampled_from([0.0, -0.0, 1.0, 0.1 + 0.2, 1e-9, 12345.678901234567]),
    st.floats(-10, 10, allow_nan=False),
)
SIZES = st.floats(1e-4, 10.0)
SEEDS = st.lists(st.integers(0, 2**63), min_size=1, max_size=3)
WORDS = {
    "integrator": ["Euler", "RK4", "implicitfast"],
    "cone": ["pyramidal", "elliptic"],
    "solver": ["Newton", "CG"],
    "jacobian": ["dense", "auto"],
}
TUPLES = {
    "solref": st.sampled_from([(0.02, 1.0), (-160000.0, -145.0), (0.005, 0.3)]),
    "solimp": st.tuples(st.just(0.8), st.just(0.9), SIZES, st.just(0.5), st.just(2.0)),
    "friction": st.tuples(SIZES, SIZES, REALS.map(abs)),
    "gravity": st.one_of(SIZES, st.tuples(REALS, REALS, REALS)),
}
WHOLE = {"iterations", "ls_iterations", "noslip_iterations", "ccd_iterations"}


def slow_id(scene: Scene, run: RunSpec) -> str:
    """Return a run's id as one JSON text of all that it is."""
    base = scene.base(run.structure)
    identity = {
        "scene": scene.hash,
        "settings": {
            name: rounded(value)
            for name, value in run.values.items()
            if name in base.settings or not is_as_written(base.model, name, value)
        },
        "written_over": sorted(run.changed_settings & base.nonuniform),
        "flags": non_default_flags(run.flags) | other_effects(base, run),
        "seed": run.seed,
        "duration": run.duration,
    }
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def rounded(value: object) -> object:
    if isinstance(value, tuple):
        return [rounded(part) for part in value]
    return float(f"{value:.12g}") if isinstance(value, float) else value


def values_of(scene: Scene) -> dict[str, st.SearchStrategy[Any]]:
    """Return what each axis of a scene may be."""
    manifest, base = scene.source.manifest, scene.base({})
    assert manifest is not None
    found: dict[str, st.SearchStrategy[Any]] = dict.fromkeys(PARAMETERS, SIZES)
    found |= {name: st.sampled_from(words) for name, words in WORDS.items()}
    found |= TUPLES | dict.fromkeys(WHOLE, st.integers(1, 9)) | {"condim": st.sampled_from([3, 6])}
    found |= dict.fromkeys(("restitution", "solref.dampratio"), st.floats(0.1, 0.9))
    found |= {name: st.booleans() for name in EFFECTS if name not in PARAMETERS}
    found |= dict.fromkeys(manifest.initial, REALS)
    for name, each in manifest.structure.items():
        near = st.sampled_from([each.default, 1.01 * each.default])
        found[name] = st.integers(1, 3) if each.integer else near
    found["engine"] = st.sampled_from(["mujoco", "impulse"])
    if "mass" in base.settings:
        found["mass"] = SIZES
    if "keyframe" in base.settings:
        found["keyframe"] = st.sampled_from([base.settings["keyframe"], "qpos0"])
    geom = next(name for index in range(base.model.ngeom) if (name := base.model.geom(index).name))
    found[f"geom_friction[{geom},1]"] = st.one_of(SIZES, st.just(0.005))
    return found


AXES = {name: values_of(scene) for name, scene in SCENES.items()}


@st.composite
def sweeps(draw: Draw) -> tuple[Scene, list[dict[str, object]]]:
    """Draw rows of one sweep, most of them with the same axes and each value in several."""
    name = draw(st.sampled_from(sorted(SCENES)))
    axes = AXES[name]
    swept = draw(st.lists(st.sampled_from(sorted(axes)), min_size=1, max_size=6, unique=True))
    pools = {axis: draw(st.lists(axes[axis], min_size=1, max_size=3)) for axis in swept}
    found: list[dict[str, object]] = []
    for _ in range(draw(st.integers(1, 8))):
        left_out = draw(st.sampled_from([None, *swept]))
        row = {axis: draw(st.sampled_from(pools[axis])) for axis in swept if axis != left_out}
        found.append(row)
    return SCENES[name].with_effects(draw(st.sampled_from([None, "auto", "all"]))), found


@pytest.mark.long
@settings(max_examples=100, deadline=None)
@given(sweep=sweeps(), seeds=SEEDS, duration=st.none() | st.floats(0.01, 5))
def test_ids_are_what_json_says(
    sweep: tuple[Scene, Sequence[Mapping[str, object]]], seeds: list[int], duration: float | None
) -> None:
    scene, found = sweep
    for values in found:
        for seed, run in zip(seeds, scene.plan_runs(values, seeds, duration), strict=True):
            alone = scene.resolve(values, seed, duration)
            assert run.values == alone.values
            assert run.run_id == scene.run_id(alone) == slow_id(scene, alone)


def test_zeros_of_either_sign_are_two_values() -> None:
    scene = SCENES["ball_drop"]
    ids = [next(scene.plan_runs({"drop_height": x}, [0], None)).run_id for x in (0.0, -0.0, 0.0)]
    assert ids[0] == ids[2] != ids[1]
