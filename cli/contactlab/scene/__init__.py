"""From what a sweep names to compiled models: scenes, parameters, engine switches."""

from contactlab.scene.axis_catalogue import LenientCatalogue
from contactlab.scene.compiled_scene import Base, Prepared
from contactlab.scene.contact_pairs import Pair, can_collide
from contactlab.scene.effects import EFFECTS, FRICTIONS, NOT_THERE, Choice, Effect
from contactlab.scene.engine_flags import FLAGS
from contactlab.scene.initial_states import OWN_START, TWIN, Starts, twin_of
from contactlab.scene.model_joints import actuated_limbs, joints_of
from contactlab.scene.mujoco_versions import has_batch, lacking_records, quiet, why_lacking
from contactlab.scene.parameters import PARAMETERS, Parameter
from contactlab.scene.plain import compile_plain, prepare_plain
from contactlab.scene.recording_sensors import PREFIX, Layout
from contactlab.scene.reference_numerics import NUMERICS, as_reference
from contactlab.scene.resolved import Resolved
from contactlab.scene.row_resolution import ResolvedRow, Shape
from contactlab.scene.run_identity import ID_BYTES
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene
from contactlab.scene.scene_source import (
    SceneSource,
    find_scene,
    is_menagerie,
    menagerie_name,
    stored_scene,
)
from contactlab.scene.written_inertia import InertiaFault, written_inertia_faults

__all__ = [
    "EFFECTS",
    "FLAGS",
    "FRICTIONS",
    "ID_BYTES",
    "NOT_THERE",
    "NUMERICS",
    "OWN_START",
    "PARAMETERS",
    "PREFIX",
    "TWIN",
    "Base",
    "Choice",
    "Effect",
    "InertiaFault",
    "Layout",
    "LenientCatalogue",
    "Pair",
    "Parameter",
    "Prepared",
    "Resolved",
    "ResolvedRow",
    "Scene",
    "SceneSource",
    "Shape",
    "Starts",
    "actuated_limbs",
    "as_reference",
    "can_collide",
    "compile_plain",
    "find_scene",
    "has_batch",
    "is_menagerie",
    "joints_of",
    "lacking_records",
    "make_setup",
    "menagerie_name",
    "prepare_plain",
    "quiet",
    "stored_scene",
    "twin_of",
    "why_lacking",
    "written_inertia_faults",
]
