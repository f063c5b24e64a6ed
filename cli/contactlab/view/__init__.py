"""A stored run to look at: films, pictures, 3D layers, the interactive viewer."""

from contactlab.view.look import Look
from contactlab.view.pictures import Picture, pictures
from contactlab.view.render import render
from contactlab.view.viewer import view

__all__ = [
    "Look",
    "Picture",
    "pictures",
    "render",
    "view",
]
