"""From what a sweep names to compiled models: scenes, parameters, engine switches."""

from contactlab.scene.axis_catalogue import EngineTraits, LenientCatalogue
from contactlab.scene.compile_model import PREFIX
from contactlab.scene.compiled_scene import CompiledScene, PreparedModel
from contactlab.scene.contact_pairs import MonitoredPair, can_collide
from contactlab.scene.effects import EFFECTS, NOT_IN_MODEL, Effect, EffectState
from contactlab.scene.initial_states import QPOS0, InitialStates, perturbed_copy
from contactlab.scene.model_joints import actuated_limbs, joints_of
from contactlab.scene.model_options import FLAGS, MODEL_ENGINE
from contactlab.scene.mujoco_versions import has_batch, silence_mujoco, why_unsupported
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.resolution import ID_BYTES, ResolvedRun
from contactlab.scene.row_resolution import ResolvedRow, RowGroup
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene, compile_without_sensors, prepare_without_sensors
from contactlab.scene.scene_source import (
    SceneSource,
    find_scene,
    is_menagerie,
    menagerie_name,
    stored_scene,
)
from contactlab.scene.setting_values import Settings, as_number
from contactlab.scene.written_inertia import InertiaFault, written_inertia_faults

__all__ = [
    "EFFECTS",
    "FLAGS",
    "ID_BYTES",
    "MODEL_ENGINE",
    "NOT_IN_MODEL",
    "PARAMETERS",
    "PREFIX",
    "QPOS0",
    "CompiledScene",
    "Effect",
    "EffectState",
    "EngineTraits",
    "InertiaFault",
    "InitialStates",
    "LenientCatalogue",
    "MonitoredPair",
    "PreparedModel",
    "ResolvedRow",
    "ResolvedRun",
    "RowGroup",
    "Scene",
    "SceneSource",
    "Settings",
    "actuated_limbs",
    "as_number",
    "can_collide",
    "compile_without_sensors",
    "find_scene",
    "has_batch",
    "is_menagerie",
    "joints_of",
    "make_setup",
    "menagerie_name",
    "perturbed_copy",
    "prepare_without_sensors",
    "silence_mujoco",
    "stored_scene",
    "why_unsupported",
    "written_inertia_faults",
]
