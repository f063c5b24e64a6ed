"""The names that a sweep of a scene may use, and the scene itself."""

from dataclasses import dataclass, field
from pathlib import Path

from contactlab.errors import SceneError
from contactlab.evidence import RESERVED
from contactlab.measure import LABELS, METRICS
from contactlab.scene import Scene
from contactlab.schema import Vocabulary


@dataclass
class Scenes:
    """Opens the scene that a sweep names, once.

    Attributes:
        folder: where relative paths of scenes start: beside the sweep file.
    """

    folder: Path | None
    _opened: dict[str, Scene] = field(default_factory=dict[str, Scene])

    def open(self, reference: str) -> Scene:
        """Return the scene.

        Raises:
            SceneError: there is none, or a name of its own is already a column's.
        """
        if reference not in self._opened:
            scene = Scene.open(reference, self.folder)
            _check_names(scene)
            self._opened[reference] = scene
        return self._opened[reference]

    def vocabulary(self, reference: str) -> Vocabulary:
        """Return every name that a sweep of the scene may use."""
        return Vocabulary(self.open(reference).catalogue, tuple(METRICS), tuple(LABELS))


def _check_names(scene: Scene) -> None:
    clashes = set(scene.catalogue.names) & (RESERVED | set(METRICS))
    if clashes:
        raise SceneError(
            f"scene '{scene.name}' offers axes named {', '.join(sorted(clashes))}, "
            "which are columns of the table already; rename them in its manifest"
        )
