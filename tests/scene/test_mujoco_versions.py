"""What an engine lacks is refused by name, with the version that has it; defaults are taken."""

import itertools
from collections.abc import Callable
from pathlib import Path

import mujoco
import pytest

from contactlab.errors import SweepFileError
from contactlab.plan.overrides import Overrides
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.scene import mujoco_versions
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.mujoco_versions import (
    NEW_FEATURES,
    NewFeature,
    silence_mujoco,
    why_unsupported,
)
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.scene import Scene

SWEEP = "version: 1\nscene: ball_drop\nduration: 0.02\n"
MATRIX = SWEEP + "zip:\n  - {integrator: [Euler, discrete], timestep: [1.0e-3, 2.0e-3]}\n"


@pytest.fixture
def version(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Take the engine for another version of itself."""
    return lambda number: monkeypatch.setattr(mujoco_versions, "VERSION", number)


def ask(text: str, *assign: str, partly: bool = False) -> SweepRequest:
    options = Overrides(assign, (), None)
    return read_request(
        text, "s", Path("nowhere"), folder=Path(), workers=0, overrides=options, partly=partly
    )


def test_the_table_agrees_with_the_installed_engine() -> None:
    for each in NEW_FEATURES:
        words = PARAMETERS[each.axis].choices if each.axis in PARAMETERS else FLAG_NAMES
        there = (each.axis if isinstance(each.value, bool) else each.value) in words
        assert there == (why_unsupported(each.axis, each.value) is None), each


@pytest.mark.parametrize("each", NEW_FEATURES, ids=lambda each: f"{each.axis}-{each.value}")
def test_refused_by_name(each: NewFeature, version: Callable[[str], None]) -> None:
    version("3.3.0")
    value = str(each.value).lower()
    for text, options in (
        (SWEEP, [f"{each.axis}={value}"]),
        (SWEEP + f"axes: {{{each.axis}: [{value}]}}\n", []),
    ):
        with pytest.raises(SweepFileError) as caught:
            ask(text, *options)
        assert "MuJoCo 3.3.0 has no " in str(caught.value)
        assert f"'{value if each.axis == 'integrator' else each.axis}'" in str(caught.value)
        assert f"came with {each.version}" in str(caught.value)
        assert f"--mujoco {each.version}" in str(caught.value)


def test_taken_from_the_version_on_that_has_it(version: Callable[[str], None]) -> None:
    arrival = NewFeature("integrator", "discrete", "3.13.0")
    for number, lacks in (
        ("3.9.1", True),
        ("3.12.9", True),
        ("3.13.0", False),
        ("4.0.1.dev5", False),
    ):
        version(number)
        assert (why_unsupported(arrival.axis, arrival.value) is not None) == lacks


def test_a_planted_arrival(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco_versions, "NEW_FEATURES", (NewFeature("hover", True, "99.0.0"),))
    with pytest.raises(SweepFileError, match=r"has no flag 'hover', which came with 99\.0\.0"):
        ask(SWEEP, "hover=true")
    # Off is what every engine does that has no such thing, and so no other run.
    scene = Scene.open("ball_drop")
    without, off = (scene.resolve(values, 0, None) for values in ({}, {"hover": False}))
    assert scene.run_id(without) == scene.run_id(off)
    assert ask(SWEEP, "hover=false").plan.count == 1


def test_what_is_lacking_is_left_out_where_that_is_asked(version: Callable[[str], None]) -> None:
    version("3.4.0")
    with pytest.raises(SweepFileError, match="no integrator 'discrete'"):
        ask(MATRIX)
    left = ask(MATRIX, partly=True)
    runs = list(left.plan.iterate_runs())
    assert [dict(run.values) for run in runs] == [{"integrator": "Euler", "timestep": 1e-3}]
    (reason,) = left.left_out
    assert "came with 3.13.0" in reason


def test_nothing_is_left_out_where_nothing_is_lacking() -> None:
    left = ask(SWEEP + "axes: {timestep: [1.0e-3, 2.0e-3]}\n", partly=True)
    assert left.plan.count == 2
    assert left.left_out == ()


@pytest.mark.parametrize(
    ("number", "batch"), [("3.3.7", False), ("3.16.0", False), ("3.17.0", True), ("4.0.0", True)]
)
def test_what_versions_can(number: str, version: Callable[[str], None], *, batch: bool) -> None:
    version(number)
    assert mujoco_versions.has_batch() == batch


def test_contact_sensors_measure_all_where_there_are_batches() -> None:
    fields = getattr(mujoco, "mjtConDataField", None)
    assert hasattr(fields, "mjCONDATA_ANGVEL") >= mujoco_versions.has_batch()


def test_the_library_is_that_of_the_running_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Installing 3.3.7 over 4.0.0 leaves the library of 4.0.0 beside its own."""
    monkeypatch.setattr(mujoco, "__file__", str(tmp_path / "__init__.py"))
    monkeypatch.setattr(mujoco, "__version__", "3.3.7")
    own = tmp_path / "libmujoco.so.3.3.7"
    for file in (own, tmp_path / "libmujoco.so.4.0.0"):
        file.touch()
    assert mujoco_versions.library_file() == own


def test_only_a_timer_of_the_program_reads_the_clock() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")

    def time_step() -> float:
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data)
        return float(data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration)

    ticks = itertools.count()
    mujoco.set_mjcb_time(lambda: next(ticks))
    try:
        silence_mujoco()
        assert time_step() > 0
    finally:
        mujoco.set_mjcb_time(None)  # installs MuJoCo's own again
    assert time_step() > 0
    silence_mujoco()
    assert time_step() == 0
