"""The starter file is a sweep file, for whatever the scene offers."""

from collections.abc import Mapping
from typing import Any

import pytest

from contactlab.plan.starter import SCHEMA_NAME, starter_text
from contactlab.plan.sweep_file import read_sweep
from contactlab.schema.vocabulary import Vocabulary

SETTINGS = {
    "timestep": 0.002,
    "integrator": "RK4",
    "cone": "elliptic",
    "solref": (0.02, 1.0),
    "iterations": 50,
}


def text_of(
    names: Vocabulary, settings: Mapping[str, object] = SETTINGS, drive: str | None = "hold"
) -> str:
    return starter_text("ball", settings, 1.5, drive, names)


def axes_of(text: str, vocabulary: Any) -> dict[str, list[Any]]:
    return {axis.name: list(axis.values) for axis in read_sweep(text, vocabulary).plan.axes}


def test_the_starter_reads(vocabulary: Any) -> None:
    text = text_of(vocabulary("ball"))
    file = read_sweep(text, vocabulary)
    assert text.splitlines()[0] == f"# yaml-language-server: $schema=./{SCHEMA_NAME}"
    assert (file.sweep.duration, file.sweep.drive, file.sweep.trace) == (1.5, "hold", "all")
    assert len(file.sweep.seed_values) == 3
    assert file.plan.warnings == ()


def test_the_first_value_of_each_axis_is_the_scene_s_own(vocabulary: Any) -> None:
    axes = axes_of(text_of(vocabulary("ball")), vocabulary)
    assert {name: values[0] for name, values in axes.items()} == {
        name: SETTINGS[name] for name in ("timestep", "integrator", "cone", "solref")
    }
    assert all(2 <= len(set(values)) <= 3 for values in axes.values())


@pytest.mark.parametrize("timestep", [0.0005, 0.002, 0.005, 0.01, 1 / 60, 2.5e-5])
@pytest.mark.parametrize("constant", [0.002, 0.02, 0.1])
def test_none_needs_refsafe_that_the_scene_does_not_need(
    timestep: float, constant: float, vocabulary: Any
) -> None:
    """MuJoCo raises a time constant to two timesteps."""
    settings = {**SETTINGS, "timestep": timestep, "solref": (constant, 1.0)}
    axes = axes_of(text_of(vocabulary("ball"), settings), vocabulary)
    assert axes["timestep"][0] == timestep
    needed = min(pair[0] for pair in axes["solref"]) < 2 * max(axes["timestep"])
    assert needed == (constant < 2 * timestep)


def test_what_geoms_do_not_share_is_left_out(vocabulary: Any) -> None:
    settings = {name: value for name, value in SETTINGS.items() if name != "solref"}
    axes = axes_of(text_of(vocabulary("ball"), settings), vocabulary)
    assert list(axes) == ["timestep", "integrator", "cone"]


def test_its_commented_lines_read_too(vocabulary: Any) -> None:
    text = text_of(vocabulary("ball"))
    for key in ("# exclude", "# include", "# expect", "#   - {w"):
        assert key in text
    body = text.replace("# exclude", "exclude").replace('#   - {where: "', '  - {where: "')
    assert read_sweep(body, vocabulary).plan.count < read_sweep(text, vocabulary).plan.count
    drive = text_of(vocabulary("ball"), drive=None).replace("# drive", "drive")
    assert read_sweep(drive, vocabulary).sweep.drive == "none"


@pytest.mark.parametrize("reference", ["ball", "my: scene #1", "./a b/c.xml"])
def test_a_scene_without_axes_or_plain_name_reads(reference: str) -> None:
    empty = Vocabulary((), lambda _: None, (), ())
    file = read_sweep(starter_text(reference, {}, 1.0, None, empty), lambda _: empty)
    assert (file.sweep.scene, file.plan.count) == (reference, 3)
