"""From what a sweep names to compiled models: scenes, parameters, engine switches."""

from contactlab.scene.base import Base, Prepared
from contactlab.scene.parameters import PARAMETERS, Parameter
from contactlab.scene.scene import Resolved, Scene
from contactlab.scene.sensors import Layout
from contactlab.scene.setup import make_setup
from contactlab.scene.source import SceneSource, find_scene, stored_scene

__all__ = [
    "PARAMETERS",
    "Base",
    "Layout",
    "Parameter",
    "Prepared",
    "Resolved",
    "Scene",
    "SceneSource",
    "find_scene",
    "make_setup",
    "stored_scene",
]
