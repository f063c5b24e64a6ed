"""Draws moments of a run as SVG, without OpenGL and without further packages."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from contactlab.contact.rotations import rotate_vectors
from contactlab.contact.trace_arrays import Floats
from contactlab.palette import mode_colour
from contactlab.store.atomic_files import atomic_write
from contactlab.view.drawn_motion import BodyMotion
from contactlab.view.drawn_shapes import BodyShape


def _camera_axes() -> Floats:
    # (3, 3): right, up and forward of the free camera of films, in the world frame.
    azimuth, elevation = np.radians(120.0), np.radians(-18.0)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    forward = np.array([*(np.cos(elevation) * level[:2]), np.sin(elevation)])
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    return np.stack([right, np.cross(right, forward), forward])


_CAMERA = _camera_axes()


def write_drawing(
    target: Path,
    moments: Sequence[tuple[BodyMotion, int, str]],
    size: tuple[int, int],
) -> None:
    """Write frames of motions, each with its words, next to each other as one SVG.

    A frame has a width and a height in pixels. Shapes are outlines without perspective, the
    farthest first; fixed ones are below the others.
    """
    width, height = size
    strip = max(14, width // 24)
    whole = len(moments) * width, height + strip
    parts = [
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{whole[0]}" height="{whole[1]}" '
            f'viewBox="0 0 {whole[0]} {whole[1]}" font-family="sans-serif" '
            f'font-size="{strip * 0.7:g}">'
            f'<rect width="{whole[0]}" height="{whole[1]}" fill="#fff"/>'
        )
    ]
    for place, (motion, frame, words) in enumerate(moments):
        parts.append(
            f'<svg x="{place * width}" width="{width}" height="{height}">'
            '<rect width="100%" height="100%" fill="#d5dde8"/>'
            f"{draw_frame(motion, frame, size)}</svg>"
            f'<text x="{place * width + 6}" y="{height + 0.75 * strip:g}" fill="#282c34">'
            f"{escape(words)}</text>"
        )
    with atomic_write(target) as temporary:
        temporary.write_text("".join(parts) + "</svg>\n", encoding="utf-8")


def draw_frame(motion: BodyMotion, frame: int, size: tuple[int, int]) -> str:
    """Return the shapes and the contact forces of a frame as SVG elements."""
    stage, half = motion.view(frame), np.array(size) / 2
    pixels_per_meter = 0.95 * half.min() / stage.radius

    def project_points(points: Floats) -> Floats:
        """Return (K, 3) points in pixels to the right and down, and the depth [pixels]."""
        projected = (points - stage.centre) @ _CAMERA.T * pixels_per_meter
        return projected * [1, -1, 1] + [*half, 0]

    faces: list[tuple[bool, float, str]] = []
    geoms: list[list[BodyShape]] = []
    for shape in motion.shapes:
        # A capsule is a cylinder with two ends.
        if geoms and shape.name in {f"{geoms[-1][0].name}/{end}" for end in ("top", "bottom")}:
            geoms[-1].append(shape)
        else:
            geoms.append([shape])
    for parts in geoms:
        shape = parts[0]
        turn, place = motion.rotations[frame, shape.body], motion.positions[frame, shape.body]
        points = np.concatenate([*map(_surface_points, parts)])
        projected = project_points(place + rotate_vectors(turn, points))
        outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in _find_outline(projected[:, :2]))
        moves = bool(motion.moving[shape.body])
        fill, edge = (
            "#" + "".join(f"{round(255 * min(1, part * dark)):02x}" for part in shape.colour[:3])
            for dark in (1.0, 0.6)
        )
        opacity = shape.colour[3] * (0.8 if moves else 1.0)  # arrows behind a body are visible
        faces.append(
            (
                moves,
                -float(projected[:, 2].mean()),
                (
                    f'<polygon points="{outline}" fill="{fill}" stroke="{edge}" '
                    f'stroke-linejoin="round" opacity="{opacity:.2g}"/>'
                ),
            )
        )
    lines = [line for *_, line in sorted(faces, key=lambda one: one[:2])]
    body = int(np.argmax(motion.moving)) if motion.followed is None else motion.followed
    way = project_points(motion.positions[: frame + 1, body])[:, :2]
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in way)
    lines.append(f'<polyline points="{path}" fill="none" stroke="#1a45fa" stroke-opacity="0.6"/>')
    chosen = motion.forces.of(frame)
    points, arrows = motion.forces.position[chosen], motion.arrows[chosen]
    begins, ends = project_points(points)[:, :2], project_points(points + arrows)[:, :2]
    for begin, end, mode in zip(begins, ends, motion.forces.mode[chosen].tolist(), strict=True):
        lines.append(_draw_arrow(begin, end, mode_colour(mode), half.min() / 60))
    return "".join(lines)


def _surface_points(shape: BodyShape) -> Floats:
    # In the frame of the body, all corners among them.
    if shape.form == "mesh":
        points = shape.vertices
    elif shape.form == "box":
        points = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
    elif shape.form == "cylinder":
        turn = np.linspace(0, 2 * np.pi, 32, endpoint=False)
        x, y = 0.5 * np.cos(turn), 0.5 * np.sin(turn)
        points = np.concatenate([np.stack([x, y, np.full(32, z)], axis=1) for z in (-0.5, 0.5)])
    else:
        around, along = np.meshgrid(np.linspace(0, 2 * np.pi, 32), np.linspace(0, np.pi, 16))
        points = 0.5 * np.stack(
            [np.sin(along) * np.cos(around), np.sin(along) * np.sin(around), np.cos(along)], axis=-1
        ).reshape(-1, 3)
    return shape.position + rotate_vectors(shape.rotation, points * shape.size)


def _find_outline(points: Floats) -> Floats:
    # The farthest points in 64 directions are corners of the convex hull.
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    farthest = np.argmax(np.stack([np.cos(angle), np.sin(angle)], axis=1) @ points.T, axis=1)
    return points[farthest[np.flatnonzero(np.diff(farthest, prepend=-1))]]


def _draw_arrow(begin: Floats, end: Floats, colour: str, width: float) -> str:
    # All lengths are in pixels.
    length = float(np.linalg.norm(end - begin))
    if not length:
        return ""
    along = (end - begin) / length
    head = min(4 * width, length / 3)
    neck, side = end - head * along, head / 2 * np.array([-along[1], along[0]])
    corners = " ".join(f"{x:.1f},{y:.1f}" for x, y in (neck + side, end, neck - side))
    ends = " ".join(
        f'{name}="{value:.1f}"'
        for name, value in zip(("x1", "y1", "x2", "y2"), (*begin, *neck), strict=True)
    )
    return (
        f'<line {ends} stroke="{colour}" stroke-width="{width:.1f}"/>'
        f'<polygon points="{corners}" fill="{colour}"/>'
    )
