"""One colour has one meaning, in every picture."""

import re
from importlib import resources
from itertools import combinations

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Floats
from contactlab.measure import LABELS
from contactlab.palette import COLOURS, LETTERS, MODE_COLOURS, SHAPES, mode_colour, on_dark


@pytest.mark.parametrize("mode", MODE_COLOURS)
def test_a_mode_has_the_same_colour_on_the_page_and_in_a_film(mode: int) -> None:
    """Of 256 levels, the nearest: half of one off at most."""
    text = mode_colour(mode)
    assert re.fullmatch("#[0-9a-f]{6}", text)
    levels = [int(text[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    assert levels == pytest.approx(MODE_COLOURS[mode][:3], abs=0.5 / 255 + 1e-12)


def test_whatever_is_told_apart_by_colour_is_by_shape_and_letter_too() -> None:
    assert len({*COLOURS}) == len(COLOURS) == len(SHAPES) == len({*LETTERS})
    assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in COLOURS)
    assert len({mode_colour(mode) for mode in MODE_COLOURS}) == len(MODE_COLOURS)


# Linear RGB as people see it who lack one kind of cone: Machado, Oliveira and Fernandes, "A
# physiologically-based model for simulation of color vision deficiency", 2009, severity 1.
SEEN_BY = {
    "all cones": np.eye(3),
    "protanopes": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deuteranopes": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "tritanopes": np.array(
        [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ]
    ),
}
# Oklab, of B. Ottosson: cone responses of linear RGB, and lightness with two opponents of these.
CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
OPPONENTS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
# A just noticeable difference in Oklab is 0.02; three of them leave no room for more labels.
LEAST_APART = 2.5 * 0.02


def oklab(colour: str, seen: Floats = SEEN_BY["all cones"]) -> Floats:
    """Return lightness, green to red, and blue to yellow of `#rrggbb`."""
    levels = np.array([int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)])
    linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return OPPONENTS @ np.cbrt(CONES @ np.clip(seen @ linear, 0, 1))


def dark_page() -> dict[str, str]:
    """Return the colours of the page and of calm parts on a dark page."""
    sheet = resources.files("contactlab.page").joinpath("style.css").read_text()
    (dark,) = re.findall(r"prefers-color-scheme: dark\) \{\s*:root \{([^}]*)\}", sheet)
    return dict(re.findall(r"--(page|calm): (#[0-9a-f]{6})", dark))


def find_free_colour() -> str:
    """Return a colour for a new label of failure: loud, not green, and far from all others."""
    steps, own = range(0, 256, 25), dark_page()
    names = [
        f"#{red:02x}{green:02x}{blue:02x}" for red in steps for green in steps for blue in steps
    ]
    _, red, yellow = np.transpose([oklab(name) for name in names])
    hue = np.degrees(np.arctan2(yellow, red)) % 360
    loud = (np.hypot(red, yellow) > 0.079) & ~((hue > 112) & (hue < 220))
    apart = np.where(loud, np.inf, 0.0)
    for seen in SEEN_BY.values():
        bright = np.array([oklab(name, seen) for name in names])
        dark = np.array([oklab(on_dark(name), seen) for name in names])
        colours = [label.colour for label in LABELS.values() if label.colour]
        taken = [(bright, colour, 1.0) for colour in colours]
        taken += [(dark, on_dark(colour), 0.85) for colour in colours]
        taken += [(dark, own["calm"], 0.85), (dark, own["page"], 2.0)]
        for places, colour, share in taken:
            distance = np.linalg.norm(places - oklab(colour, seen), axis=1) / share
            apart = np.minimum(apart, distance)
    return names[int(apart.argmax())]


def test_each_label_has_a_colour() -> None:
    without = [name for name, label in LABELS.items() if not label.colour]
    assert without == [], f"a colour that is free: {find_free_colour()}"


@pytest.mark.parametrize("eyes", SEEN_BY)
def test_no_two_labels_look_alike_to_anyone(eyes: str) -> None:
    seen = {name: oklab(label.colour, SEEN_BY[eyes]) for name, label in LABELS.items()}
    near = [
        (one, other)
        for one, other in combinations(seen, 2)
        if np.linalg.norm(seen[one] - seen[other]) < LEAST_APART
    ]
    assert near == [], f"a colour that is free: {find_free_colour()}"


@pytest.mark.parametrize("eyes", SEEN_BY)
def test_on_a_dark_page_labels_are_told_apart_and_from_the_page(eyes: str) -> None:
    """All distances shrink by what all colours go towards white, 15 %; a page is six steps away."""
    own = dark_page()
    labels = {label.colour for label in LABELS.values() if not label.is_good}
    seen = {colour: oklab(on_dark(colour), SEEN_BY[eyes]) for colour in labels}
    calm, page = (oklab(own[name], SEEN_BY[eyes]) for name in ("calm", "page"))
    pairs = [*combinations(seen.values(), 2), *((each, calm) for each in seen.values())]
    assert min(np.linalg.norm(one - other) for one, other in pairs) > 0.85 * LEAST_APART
    assert min(np.linalg.norm(each - page) for each in seen.values()) > 2 * LEAST_APART


@pytest.mark.parametrize("colour", ["#1845fb", "#681800", "#82857e"])
def test_on_a_dark_page_a_colour_goes_towards_white_and_keeps_its_hue(colour: str) -> None:
    """By .15 of the way, within half a level of 256, which is 6e-3 in Oklab for dark colours."""
    before, white = oklab(colour), np.array([1.0, 0, 0])
    assert oklab(on_dark(colour)) == pytest.approx(before + 0.15 * (white - before), abs=6e-3)


def test_stable_is_calm_and_failure_is_loud_and_never_green() -> None:
    """Chroma is the distance from grey; of sRGB's green the hue is 142 degrees."""
    for label in LABELS.values():
        _, red, yellow = oklab(label.colour)
        chroma, hue = np.hypot(red, yellow), np.degrees(np.arctan2(yellow, red)) % 360
        if label.is_good:
            assert chroma < 0.02
        if label.severity in ("bad", "poor"):
            assert chroma > 0.079
            assert not 112 < hue < 220
