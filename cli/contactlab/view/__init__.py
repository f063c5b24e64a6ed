"""A stored run to look at: films, pictures, files for 3D viewers, the interactive viewer."""

from contactlab.view.live_viewer import open_viewer
from contactlab.view.mujoco_pictures import Picture, draw_pictures
from contactlab.view.picture_options import PictureOptions
from contactlab.view.render import render

__all__ = [
    "Picture",
    "PictureOptions",
    "draw_pictures",
    "open_viewer",
    "render",
]
