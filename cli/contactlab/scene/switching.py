"""What a scene and a sweep ask of effects by name, written into settings and switches."""

from collections.abc import MutableMapping

from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.axis_catalogue import SceneCatalogue
from contactlab.scene.effects import EFFECTS, fold
from contactlab.scene.engine_flags import FLAGS
from contactlab.schema import SceneManifest, switches


def is_auto(manifest: SceneManifest | None) -> bool:
    """Say whether a scene leaves out what provably changes nothing, unless its sweep says.

    A bare model is taken as it is written.
    """
    return manifest is not None and manifest.effects.get("base", "auto") == "auto"


def own_switches(manifest: SceneManifest | None, catalogue: SceneCatalogue) -> dict[str, object]:
    """Return the effects that a scene switches itself, by name.

    Raises:
        SceneError: there is no such effect, or it cannot be switched that way.
    """
    found: dict[str, object] = {}
    for name, value in switches(manifest.effects if manifest else {}).items():
        spec = catalogue.find(name) if name in EFFECTS else None
        if spec is None:
            raise SceneError(f"effects: no effect '{name}'{did_you_mean(name, EFFECTS)}")
        try:
            found[name] = spec.parse(value)
        except ValueError as error:
            raise SceneError(f"effects: {name}: {error}") from error
    return found


def switch_effect(
    name: str,
    on: bool,
    settings: MutableMapping[str, object],
    flags: MutableMapping[str, bool],
) -> set[str]:
    """Write an effect into settings or switches; return the names of what it sets.

    An effect that is a matter of neither is its own name.
    """
    if name in FLAGS:
        flags[name] = on
    elif fold(name, on=on, settings=settings):
        return set(EFFECTS[name].touches)
    return {name}
