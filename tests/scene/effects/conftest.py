"""Models of runs as `effects` decides them."""

from typing import Protocol

import pytest

from contactlab.scene.compiled_scene import PreparedModel
from contactlab.scene.scene import Scene


class Prepare(Protocol):
    """Returns the model of a scene's run."""

    def __call__(
        self, scene: Scene, rest: str | None = "auto", **values: object
    ) -> PreparedModel: ...


@pytest.fixture(scope="session")
def prepared() -> Prepare:
    """Return a maker of models: what holds for effects not named, and axis values."""

    def prepare(scene: Scene, rest: str | None = "auto", **values: object) -> PreparedModel:
        scene = scene.with_effects(rest)
        run = scene.resolve(values, 0, None)
        return scene.prepare(run, scene.initial_states([run]))

    return prepare
