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
# Families of labels: a hue, and labels by letter, which are of the run itself, of numbers, contact
# detection, depth, energy, motion, friction and expectations. A label looks the same everywhere.
_FAMILIES = (
    (7, "1=crashed 2=timeout 3=invalid 4=buffer_overflow"),
    (2, "D=diverged N=solver_nonconvergence J=step_dependent I=solver_inconsistent"),
    (0, "T=tunneling M=missed_contact B=broken H=phantom_contact F=contact_at_distance"),
    (5, "P=deep_penetration Q=squeezed G=penetration_growth X=exploited"),
    (1, "E=energy_injection K=constraint_gain L=energy_loss V=constraint_violated"),
    (3, "C=chatter U=unsettled W=drift A=asleep_unsupported"),
    (4, "S=slipping R=creep Z=unexpected_slide Y=unexpected_stick"),
    (8, "O=oracle_miss 5=pair_expectation 6=contacts_cut"),
)
# Farther from the first blue than the second blue is.
_VIOLET = "#a27fdc"
# Of one family the colours differ by how much of white, or of black, is mixed in.
_SHADES = (0.0, 0.4, -0.35, 0.65, -0.6)
MODE_COLOURS = {
    NO_CONTACT: (0.4, 0.4, 0.4, 1.0),
    STICK: (0.0, 0.62, 0.45, 1.0),
    SLIDE: (0.84, 0.37, 0.0, 1.0),
}
"""Red, green, blue and opacity of contact modes, after Okabe and Ito: grey, green, vermilion."""


def _shaded(colour: str, shade: float) -> str:
    """Return a colour `#rrggbb` with a share of white mixed in; of black, if it is negative."""
    end = 255 if shade > 0 else 0
    parts = (int(colour[place : place + 2], 16) for place in (1, 3, 5))
    return "#" + "".join(f"{round(part + abs(shade) * (end - part)):02x}" for part in parts)


def _entries(family: str) -> list[tuple[str, str, str]]:
    return [each.partition("=") for each in family.split()]


LABEL_LETTERS = {name: letter for _, own in _FAMILIES for letter, _, name in _entries(own)}
LABEL_COLOURS = {
    name: _shaded((*COLOURS, _VIOLET)[hue], shade)
    for hue, own in _FAMILIES
    for (_, _, name), shade in zip(_entries(own), _SHADES, strict=False)
}


def mode_colour(mode: int) -> str:
    """Return the colour of a contact mode as `#rrggbb`."""
    red, green, blue, _ = (round(255 * part) for part in MODE_COLOURS[mode])
    return f"#{red:02x}{green:02x}{blue:02x}"
