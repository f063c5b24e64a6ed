"""A stored run as a file to look at."""

from contactlab.pipeline.rendering.look import Look
from contactlab.pipeline.rendering.render import render

__all__ = ["Look", "render"]
