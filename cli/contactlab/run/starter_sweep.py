"""The sweep to start from for a scene: around its own values, driven, and small."""

from contactlab.plan.starter import SceneAsWritten, starter
from contactlab.run.sweep_request import SceneLoader


def starter_sweep(reference: str, loader: SceneLoader) -> str:
    """Return the text of a sweep file to start from.

    Args:
        reference: the scene, as the file will name it.
        loader: opens the scene.

    Raises:
        SceneError: there is no such scene, or it does not compile.
    """
    scene = loader.open(reference)
    base, bare = scene.base({}), scene.source.manifest is None
    written = SceneAsWritten(
        reference=reference,
        settings={name: base.settings[name] for name in base.settings.keys() - base.nonuniform},
        duration=scene.duration,
        drive=("hold" if base.model.nu else "exercise") if bare else None,
    )
    return starter(written, loader.vocabulary(reference))
