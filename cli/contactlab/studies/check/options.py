"""The options `--set` of a check: one value an axis, read as a sweep's options are."""

import json
from collections.abc import Mapping, Sequence

from contactlab.errors import SweepFileError
from contactlab.plan import Overrides, read_sweep
from contactlab.run.job import IMPULSE
from contactlab.run.vocabulary import Scenes
from contactlab.scene import PARAMETERS, Scene
from contactlab.schema import Sweep

_KEYS = {"version", "scene", "axes", "duration"}


def read_options(
    scenes: Scenes, reference: str, assign: Sequence[str]
) -> tuple[Mapping[str, object], float | None]:
    """Return the values of axes and the duration [s], None if it is not set.

    Raises:
        SweepFileError: an option is wrong, or gives more than one value.
    """
    text = json.dumps({"version": 1, "scene": reference})
    read = read_sweep(text, scenes.vocabulary, Overrides(assign))
    asked = read.sweep.model_dump(exclude_defaults=True)
    if foreign := sorted(set(asked) & set(Sweep.model_fields) - _KEYS):
        raise SweepFileError(f"--set {foreign[0]}: a check takes axes of the model, and duration")
    for axis in read.plan.axes:
        if axis.count > 1:
            raise SweepFileError(
                f"--set {axis.name}: a check takes one value, not {axis.count}; "
                "to compare several, write a sweep"
            )
    values = next(read.plan.runs()).values
    if values.get("engine") == IMPULSE:
        raise SweepFileError("--set engine: a check is of a model in MuJoCo")
    return values, read.sweep.duration


def whole_settings(scene: Scene, values: Mapping[str, object]) -> dict[str, object]:
    """Put the settings that values change in their place, so that a check may change them too."""
    settings = scene.resolve(values, 0, None).settings
    whole: dict[str, object] = {}
    for name, value in values.items():
        changed = PARAMETERS[name].sets if name in PARAMETERS else name
        whole[changed] = settings[changed] if name in PARAMETERS else value
    return {name: axis_value(name, value) for name, value in whole.items()}


def axis_value(name: str, value: object) -> object:
    """Return a resolved setting as the axis of its name takes it."""
    if name != "friction":
        return value
    assert isinstance(value, tuple)
    return value[0], value[2], value[3]
