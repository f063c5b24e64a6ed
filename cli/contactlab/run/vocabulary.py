"""The names that a sweep of a scene may use, and the scene itself."""

from dataclasses import dataclass, field
from pathlib import Path

from contactlab.errors import SceneError, did_you_mean
from contactlab.measure import LABELS, METRICS, ORACLES, THRESHOLDS, limits
from contactlab.scene import Scene
from contactlab.schema import Vocabulary
from contactlab.store import RESERVED_COLUMNS


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
            _check_manifest(scene)
            self._opened[reference] = scene
        return self._opened[reference]

    def vocabulary(self, reference: str) -> Vocabulary:
        """Return every name that a sweep of the scene may use."""
        scene = self.open(reference)
        return Vocabulary(scene.catalogue, tuple(METRICS), tuple(LABELS), tuple(THRESHOLDS))


def _check_names(scene: Scene) -> None:
    clashes = set(scene.catalogue.names) & (RESERVED_COLUMNS | set(METRICS))
    if clashes:
        raise SceneError(
            f"scene '{scene.name}' offers axes named {', '.join(sorted(clashes))}, "
            "which are columns of the table already; rename them in its manifest"
        )


def _check_manifest(scene: Scene) -> None:
    """Check what only the tables of metrics know: thresholds, tolerances and the oracle."""
    manifest = scene.source.manifest
    if manifest is None:
        return
    limits(manifest.thresholds)
    for name in manifest.tolerances:
        if name not in METRICS:
            raise SceneError(f"no metric '{name}'{did_you_mean(name, METRICS)}")
    oracle = manifest.oracle
    if oracle and oracle.name not in ORACLES:
        raise SceneError(f"no oracle '{oracle.name}'{did_you_mean(oracle.name, ORACLES)}")
