"""From what a sweep names to compiled models: scenes, parameters, engine switches."""

from contactlab.scene.base import Base, Prepared
from contactlab.scene.flags import FLAGS
from contactlab.scene.pairs import Pair, can_collide
from contactlab.scene.parameters import PARAMETERS, Parameter
from contactlab.scene.quiet import quiet
from contactlab.scene.scene import Resolved, Scene
from contactlab.scene.sensors import Layout
from contactlab.scene.setup import make_setup
from contactlab.scene.source import SceneSource, find_scene, stored_scene
from contactlab.scene.start import Starts

__all__ = [
    "FLAGS",
    "PARAMETERS",
    "Base",
    "Layout",
    "Pair",
    "Parameter",
    "Prepared",
    "Resolved",
    "Scene",
    "SceneSource",
    "Starts",
    "can_collide",
    "find_scene",
    "make_setup",
    "quiet",
    "stored_scene",
]
