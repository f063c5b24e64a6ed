"""The starter file is a sweep file, for whatever the scene offers."""

from typing import Any

import pytest

from contactlab.plan.starter import SCHEMA_NAME, starter
from contactlab.plan.sweep_file import read_sweep
from contactlab.schema.vocabulary import AxisSpec, Vocabulary


class NoAxes:
    @property
    def names(self) -> list[str]:
        return []

    def find(self, name: str) -> AxisSpec | None:
        del name


def test_the_starter_reads(vocabulary: Any) -> None:
    text = starter("ball", vocabulary("ball"))
    file = read_sweep(text, vocabulary)
    assert text.splitlines()[0] == f"# yaml-language-server: $schema=./{SCHEMA_NAME}"
    assert [axis.name for axis in file.plan.axes] == ["timestep", "integrator", "cone"]
    assert file.plan.warnings == ()


def test_its_commented_lines_read_too(vocabulary: Any) -> None:
    text = starter("ball", vocabulary("ball"))
    for key in ("# duration", "# exclude", "# include", "# tolerances", "# expect", "#   - {w"):
        assert key in text
    body = text.replace("# exclude", "exclude").replace('#   - {where: "', '  - {where: "')
    assert read_sweep(body, vocabulary).plan.count < read_sweep(text, vocabulary).plan.count


@pytest.mark.parametrize("scene", ["ball", "my: scene #1", "./a b/c.xml"])
def test_a_scene_without_axes_or_plain_name_reads(scene: str) -> None:
    empty = Vocabulary(NoAxes(), (), ())
    file = read_sweep(starter(scene, empty), lambda _: empty)
    assert (file.sweep.scene, file.plan.count) == (scene, 1)
