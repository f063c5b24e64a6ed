"""Every axis that one scene offers."""

from collections.abc import Sequence

from contactlab.errors import SceneError
from contactlab.scene.base import Base
from contactlab.scene.fields import field_axis
from contactlab.scene.flags import FLAGS
from contactlab.scene.parameters import CONTACT_SETTINGS, PARAMETERS
from contactlab.scene.settings import ENGINES
from contactlab.scene.values import choice, integer, number, switch
from contactlab.schema import AxisSpec, SceneManifest


class SceneCatalogue:
    """The axes of a scene: its own initial and structure values, parameters, engine switches.

    Model fields such as `dof_damping[hinge]` are found, though not listed.
    """

    def __init__(self, base: Base, manifest: SceneManifest | None) -> None:
        self._model = base.model
        self._axes = {axis.name: axis for axis in _axes(base, manifest)}

    @property
    def names(self) -> Sequence[str]:
        """Names to list and to suggest."""
        return tuple(self._axes)

    def find(self, name: str) -> AxisSpec | None:
        """Return the axis of this name, or None."""
        try:
            return self._axes.get(name) or field_axis(self._model, name)
        except ValueError:
            return None


def _axes(base: Base, manifest: SceneManifest | None) -> list[AxisSpec]:
    axes = [
        parameter.axis
        for parameter in PARAMETERS.values()
        if parameter.sets not in CONTACT_SETTINGS or base.pairs
    ]
    text = "what computes: MuJoCo, or the impulse law for a sphere above a plane"
    axes.append(AxisSpec("engine", "", text, choice(ENGINES), ENGINES))
    if base.targets.subject is not None:
        body = base.model.body(base.targets.subject).name
        axes.append(AxisSpec("mass", "kg", f"mass of '{body}', inertia with it", number(above=0)))
    switches = [name for name in FLAGS if name not in PARAMETERS]
    axes += [AxisSpec(name, "", "engine switch", switch) for name in switches]
    own = _own_axes(manifest) if manifest else []
    taken = {"mass", "seed", *PARAMETERS, *FLAGS}
    for name in (axis.name for axis in own):
        if name in taken:
            raise SceneError(f"'{name}' names something else already; give the value another name")
        taken.add(name)
    return own + axes


def _own_axes(manifest: SceneManifest) -> list[AxisSpec]:
    initial = [
        AxisSpec(name, entry.unit, entry.description, number())
        for name, entry in manifest.initial.items()
    ]
    structure = [
        AxisSpec(
            name, entry.unit, entry.description, integer(1) if entry.integer else number(above=0)
        )
        for name, entry in manifest.structure.items()
    ]
    return initial + structure
