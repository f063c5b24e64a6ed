"""From what a sweep names to compiled models: scenes, parameters, engine switches."""

from contactlab.scene.base import Base, Prepared
from contactlab.scene.capabilities import has_batch, lacking_records, why_lacking
from contactlab.scene.catalogue import LenientCatalogue
from contactlab.scene.effects import EFFECTS, FRICTIONS, NOT_THERE, Choice, Effect
from contactlab.scene.flags import FLAGS
from contactlab.scene.identity import ID_BYTES
from contactlab.scene.inertia import inertia_faults, scene_inertia_faults
from contactlab.scene.inertia_rules import InertiaFault
from contactlab.scene.joints import TWIN, joints_of, twin_of
from contactlab.scene.keyframes import OWN_START
from contactlab.scene.limbs import actuated_limbs
from contactlab.scene.menagerie import is_menagerie, menagerie_name
from contactlab.scene.numerics import NUMERICS, as_reference
from contactlab.scene.pairs import Pair, can_collide
from contactlab.scene.parameters import PARAMETERS, Parameter
from contactlab.scene.plain import compile_plain, prepare_plain
from contactlab.scene.quiet import quiet
from contactlab.scene.resolved import Resolved
from contactlab.scene.rows import ResolvedRow, Shape
from contactlab.scene.scene import Scene
from contactlab.scene.sensors import PREFIX, Layout
from contactlab.scene.setup import make_setup
from contactlab.scene.source import SceneSource, find_scene, stored_scene
from contactlab.scene.starts import Starts
from contactlab.scene.written import written_inertia_faults

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
    "inertia_faults",
    "is_menagerie",
    "joints_of",
    "lacking_records",
    "make_setup",
    "menagerie_name",
    "prepare_plain",
    "quiet",
    "scene_inertia_faults",
    "stored_scene",
    "twin_of",
    "why_lacking",
    "written_inertia_faults",
]
