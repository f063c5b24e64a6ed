"""From what a sweep names to compiled models: scenes, parameters, engine switches."""

from contactlab.scene.base import Base, Prepared
from contactlab.scene.pairs import Pair
from contactlab.scene.parameters import PARAMETERS, Parameter
from contactlab.scene.quiet import quiet
from contactlab.scene.scene import Resolved, Scene
from contactlab.scene.sensors import Layout
from contactlab.scene.setup import make_setup
from contactlab.scene.source import SceneSource, find_scene, stored_scene
from contactlab.scene.start import Starts

__all__ = [
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
    "find_scene",
    "make_setup",
    "quiet",
    "stored_scene",
]
