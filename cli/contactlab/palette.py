"""Colours and shapes of every picture: methods, labels, contact modes."""

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK

# The eight colours of M. A. Petroff, "Accessible color sequences for data visualization", 2021.
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
"""Red, green, blue and opacity of contact modes, after Okabe and Ito: grey, green, vermilion."""


def mode_colour(mode: int) -> str:
    """Return the colour of a contact mode as `#rrggbb`."""
    red, green, blue, _ = (round(255 * part) for part in MODE_COLOURS[mode])
    return f"#{red:02x}{green:02x}{blue:02x}"
