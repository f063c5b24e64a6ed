"""Compiles a model under examination from its files with changes, as its user would run it."""

import mujoco

from contactlab.budget.motion import INTEGRATION
from contactlab.scene.model_draft import CompiledFiles, ModelEdits, drop_textures, edit_spec
from contactlab.scene.motion_model import drop_drawn_data
from contactlab.tasks.checked_model import CheckedModel


def compile_changed(checked: CheckedModel, edits: ModelEdits) -> mujoco.MjModel:
    """Return the model of a scene's files with edits, without recording and drawn data.

    If its state has another size than that of the task's motions, it is the model of the motions.

    Raises:
        SceneError: the files with the edits do not compile.
    """
    scene = checked.scene.with_effects("all")

    def edit_scene(spec: mujoco.MjSpec) -> None:
        edit_spec(spec, edits)
        drop_textures(spec)

    settings = {**checked.values, **edits.settings}
    files = CompiledFiles.from_scene(scene, scene.source, settings, edit_scene)
    own = checked.motions[0].model
    if mujoco.mj_stateSize(files.model, INTEGRATION) != mujoco.mj_stateSize(own, INTEGRATION):
        return own
    return drop_drawn_data(files.model, keeps_rays=False)
