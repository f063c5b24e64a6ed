"""A run's identity: all that decides its trajectory, and nothing else."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from contactlab import resources
from contactlab.scene import model_edits
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.scene import Scene

BALL = Scene.open("ball_drop")
SWITCHES = [flag for flag in FLAG_NAMES if flag not in PARAMETERS]
OTHER: dict[str, Any] = {
    "timestep": 0.001, "integrator": "RK4", "cone": "elliptic", "solver": "CG", "jacobian": "dense",
    "iterations": 7, "tolerance": 1e-3, "ls_iterations": 7, "ls_tolerance": 0.1,
    "noslip_iterations": 7, "noslip_tolerance": 1e-3, "ccd_iterations": 7, "ccd_tolerance": 1e-3,
    "sdf_iterations": 7, "sdf_initpoints": 7,
    "impratio": 7.0, "density": 7.0, "viscosity": 7.0, "gravity": 7.0, "solref": (0.01, 0.7),
    "solref.timeconst": 0.01, "solref.dampratio": 0.7, "solref.stiffness": 7.0,
    "solref.damping": 7.0, "restitution": 0.7, "solimp": (0.7, 0.8, 0.01, 0.4, 3.0),
    "solimp.dmin": 0.7, "solimp.dmax": 0.7, "solimp.width": 0.7, "solimp.midpoint": 0.7,
    "solimp.power": 7.0, "friction": (0.7, 0.07, 0.007), "friction.slide": 0.7,
    "friction.torsion": 0.7, "friction.roll": 0.7, "condim": 6, "margin": 0.007, "gap": 0.007,
    "stiffness": 7.0, "depth_at_rest": 0.007,
    "mass": 7.0, "drop_height": 0.7, "geom_friction[ball,1]": 0.7, "geom_priority[ball]": 7,
}  # fmt: skip


def run_id(
    scene: Scene, values: dict[str, Any], seed: int = 0, duration: float | None = None
) -> str:
    return scene.run_id(scene.resolve(values, seed, duration))


def test_every_parameter_is_tried() -> None:
    assert OTHER.keys() >= PARAMETERS.keys()


def test_every_setting_counts() -> None:
    changes: list[dict[str, Any]] = [{name: value} for name, value in OTHER.items()]
    changes += [{flag: not BALL.base({}).flags[flag]} for flag in SWITCHES]
    ids = [run_id(BALL, values) for values in ({}, *changes)]
    # A time constant or a damping ratio replaces the direct solref of this scene.
    assert len(set(ids)) == len(ids)


def test_seed_and_duration_count() -> None:
    ids = {run_id(BALL, {}), run_id(BALL, {}, seed=1), run_id(BALL, {}, duration=1.0)}
    assert len(ids) == 3
    assert run_id(BALL, {}, duration=BALL.duration) == run_id(BALL, {})


def test_structure_counts() -> None:
    stack = Scene.open("box_stack")
    assert run_id(stack, {"boxes": 3}) != run_id(stack, {"boxes": 4})
    assert run_id(stack, {"boxes": 10}) == run_id(stack, {})


def test_resolved_settings_decide() -> None:
    base = BALL.base({})
    own: dict[str, Any] = {
        "timestep": 0.002,
        "solref": (-160000.0, -144.7),
        "solref.damping": 144.7,
        "friction.slide": 1.0,
        "friction": (1.0, 0.005, 0.0001),
        "condim": 3,
        "mass": 1.0,
        "drop_height": 1.0,
        "gravity": 9.81,
        "geom_friction[ball]": (1.0, 0.005, 0.0001),
        **{flag: base.flags[flag] for flag in SWITCHES},
    }
    for name, value in own.items():
        assert run_id(BALL, {name: value}) == run_id(BALL, {}), name
    assert run_id(BALL, own) == run_id(BALL, {})


def test_a_setting_written_over_unequal_pairs_counts(unequal: Scene) -> None:
    # What stands in the first pair is what the others are given, which changes them.
    own = unequal.base({}).settings["solref"]
    assert run_id(unequal, {"solref": own}) != run_id(unequal, {})


def test_order_and_last_digits_do_not_count() -> None:
    values = {"restitution": 0.4, "timestep": 0.001, "solref.stiffness": 1e5, "cone": "elliptic"}
    assert run_id(BALL, dict(reversed(values.items()))) == run_id(BALL, values)
    assert run_id(BALL, {"timestep": 0.001 * (1 + 1e-15)}) == run_id(BALL, {"timestep": 0.001})
    assert run_id(BALL, {"timestep": 0.001 * (1 + 1e-9)}) != run_id(BALL, {"timestep": 0.001})


def test_the_place_of_the_folder_does_not_count(tmp_path: Path) -> None:
    shutil.copytree(resources.MODELS / "ball_drop", tmp_path / "deep" / "else")
    moved = Scene.open(str(tmp_path / "deep" / "else"))
    assert run_id(moved, {}) == run_id(BALL, {})


@pytest.mark.parametrize("file", ["scene.xml", "scene.yaml"])
def test_the_files_content_counts(file: str, tmp_path: Path) -> None:
    folder = tmp_path / "ball"
    shutil.copytree(resources.MODELS / "ball_drop", folder)
    path = folder / file
    path.write_text(path.read_text() + "\n")
    assert run_id(Scene.open(str(folder)), {}) != run_id(BALL, {})


def test_switches_that_an_older_engine_lacks_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    newest = {"speculative", "diagexact", "multiccd"}
    here = [run_id(BALL, {"island": False}), run_id(BALL, {})]
    for table in ("_DISABLE_BITS", "_ENABLE_BITS"):
        kept = {
            name: bit for name, bit in getattr(model_edits, table).items() if name not in newest
        }
        monkeypatch.setattr(model_edits, table, kept)
    older = Scene.open("ball_drop")
    assert not newest & older.base({}).flags.keys()
    assert [run_id(older, {"island": False}), run_id(older, {})] == here
