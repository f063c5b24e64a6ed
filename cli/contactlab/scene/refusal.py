"""Why the engine refuses a model, with what to write instead."""

from collections.abc import Iterator
from pathlib import Path

import mujoco

from contactlab.errors import SceneError
from contactlab.scene.references import references
from contactlab.scene.written import written_inertia_faults

_MOST = 3


def refusal(model: Path, tried: Path, error: Exception) -> SceneError:
    """Return the error for a model that does not compile.

    Args:
        model: its file, for the message.
        tried: the file that was compiled, which may be a copy.
        error: what the engine says.
    """
    said = str(error).strip().replace(str(tried), str(model)).splitlines()
    lines = [*said, *_missing(said[0], model), *_unreal(said[0], tried)]
    return SceneError("\n  ".join([f"{model}: does not compile", *lines]))


def _unreal(said: str, tried: Path) -> Iterator[str]:
    """Yield which inertias no body has."""
    if "inertia" in said:
        # The engine gives no access to a specification that it has refused.
        spec = mujoco.MjSpec.from_file(str(tried))
        for fault in written_inertia_faults(spec)[:_MOST]:
            yield f"body '{fault.body}': {fault.reason}"


def _missing(said: str, model: Path) -> Iterator[str]:
    """Yield where a file that cannot be opened was looked for."""
    if "opening file" not in said:
        return
    for path in references(model):
        if not path.is_file() and f"{path.name}'" in said:
            yield f"it was looked for at {path}; put it there, or say where it is:"
            yield _ELSEWHERE[model.suffix == ".urdf"]
            return


_ELSEWHERE = {
    False: '<compiler meshdir="FOLDER"/>, relative to the model',
    True: '<mujoco><compiler meshdir="FOLDER" strippath="true"/></mujoco> within <robot>',
}
