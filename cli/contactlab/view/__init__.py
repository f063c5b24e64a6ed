"""A stored run to look at: films, pictures, 3D layers, the interactive viewer."""

from contactlab.view.live_viewer import view
from contactlab.view.mujoco_pictures import Picture, draw_pictures
from contactlab.view.picture_options import PictureOptions
from contactlab.view.render import render

__all__ = [
    "Picture",
    "PictureOptions",
    "draw_pictures",
    "render",
    "view",
]
