"""Colours and shapes that stay apart for everyone."""

# The eight colours of M. A. Petroff, "Accessible color sequences for data visualization", 2021.
COLOURS = (
    "#1845fb",
    "#ff5e02",
    "#c91f16",
    "#c849a9",
    "#adad7d",
    "#86c8dd",
    "#578dff",
    "#656364",
)
SHAPES = (
    "circle",
    "square",
    "triangle-up",
    "diamond",
    "triangle-down",
    "triangle-right",
    "triangle-left",
    "circle",
)
LETTERS = "ABCDEFGH"
REST = "#c4c4c4"
INK = "#222222"
