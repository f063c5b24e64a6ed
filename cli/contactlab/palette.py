"""Colours and shapes of every picture: methods, labels, contact modes."""

import numpy as np

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK

# The eight colors of M. A. Petroff, "Accessible color sequences for data visualization", 2021.
COLOURS = ("#1845fb", "#ff5e02", "#c91f16", "#c849a9", "#adad7d", "#86c8dd", "#578dff", "#656364")
SHAPES = (
    *("circle", "square", "triangle-up", "diamond"),
    *("triangle-down", "triangle-right", "triangle-left", "circle"),
)
LETTERS = "ABCDEFGH"
OTHERS_COLOUR = "#c4c4c4"
UNCHANGED_COLOUR = "#eeeeee"
INK = "#222222"
STABLE_COLOUR = "#dbe5de"
"""Pale, so that stable runs stay in the background."""
MODE_COLOURS = {
    NO_CONTACT: (0.4, 0.4, 0.4, 1.0),
    STICK: (0.0, 0.62, 0.45, 1.0),
    SLIDE: (0.84, 0.37, 0.0, 1.0),
}
"""Red, green, blue and opacity of contact modes, after Okabe and Ito: gray, green, vermilion."""


def mode_colour(mode: int) -> str:
    """Return the color of a contact mode as `#rrggbb`."""
    red, green, blue, _ = (round(255 * part) for part in MODE_COLOURS[mode])
    return f"#{red:02x}{green:02x}{blue:02x}"


# Oklab, of B. Ottosson, 2020: cone responses of linear RGB, and lightness with two opponents.
_CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_OPPONENTS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def on_dark(colour: str) -> str:
    """Return how `#rrggbb` is drawn on a dark page: nearer to white by the same share for all.

    In Oklab, so that hues stay, and distances between colors shrink by that share alone.
    """
    levels = np.array([int(colour[place : place + 2], 16) for place in (1, 3, 5)]) / 255
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    opponent_colour = _OPPONENTS @ np.cbrt(_CONES @ linear)
    towards_white = 0.15
    white = np.array([1.0, 0.0, 0.0])
    lifted = opponent_colour + towards_white * (white - opponent_colour)
    linear = np.linalg.solve(_CONES, np.linalg.solve(_OPPONENTS, lifted) ** 3).clip(0, 1)
    levels = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{round(255 * level):02x}" for level in levels.tolist())
