"""Pictures show bodies where the camera sees them; films have the length that is asked for."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import av
import mujoco
import numpy as np
import pytest
from PIL import Image

from contactlab.contact.trace_arrays import STICK
from contactlab.contact.trace_setup import RecordedMotion
from contactlab.errors import OutputError, SceneError
from contactlab.view.drawn_motion import ContactForces, follow_body, read_motion
from contactlab.view.film import (
    Picture,
    RunPictures,
    draw_pictures,
    force_bar,
    recorded_poses,
    set_looks,
    side_by_side,
)
from contactlab.view.render import PictureOptions, render_run

SIZE = (160, 120)
Draw = Callable[[str], Any]
Target = Callable[[str], Path]


@pytest.fixture(autouse=True)
def graphics(drawn: Draw) -> None:
    """Skip where the system cannot draw."""
    try:
        take(drawn("ball"), [0])
    except SceneError as error:
        if "no pictures" not in str(error):
            raise
        pytest.skip(str(error))


def take(run: Any, frames: list[int], camera: str | None = None) -> list[Picture]:
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    chosen = {frame: run.trace.qpos[motion.rows[frame]] for frame in frames}
    return list(draw_pictures(run.model, motion, chosen, SIZE, camera))


def bluish(picture: Picture) -> Any:
    """Return which pixels are more blue than floor and background: the body's."""
    return picture[..., 2].astype(int) - picture[..., 0] > 45


def greenish(picture: Picture) -> Any:
    """Return which pixels are more green than anything but an arrow that sticks."""
    red, green, blue = np.moveaxis(picture.astype(int), 2, 0)
    return (green - red > 45) & (green > blue)


@pytest.mark.long
def test_a_ball_is_where_the_camera_sees_it(drawn: Draw) -> None:
    """By a pinhole camera: azimuth 120, elevation -18 degrees, 45 degrees of view up and down."""
    run = drawn("ball")
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    distance = 1.05 * motion.radius / np.sin(np.radians(45 / 2))
    azimuth, elevation = np.radians(120), np.radians(-18)
    forward = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    eye = motion.centre - distance * forward
    right = np.cross(forward, [0, 0, 1]) / np.linalg.norm(np.cross(forward, [0, 0, 1]))
    up = np.cross(right, forward)
    focal = SIZE[1] / 2 / np.tan(np.radians(45 / 2))
    for frame, picture in zip((0, 4, 6), take(run, [0, 4, 6]), strict=True):
        ball = motion.positions[frame, 1] - eye
        x = SIZE[0] / 2 + focal * (ball @ right) / (ball @ forward)
        y = SIZE[1] / 2 - focal * (ball @ up) / (ball @ forward)
        rows, columns = np.nonzero(bluish(picture))
        # Shading and the shadow that shines through move the middle by less than half a radius.
        radius = focal * 0.05 / distance
        assert np.median(columns) == pytest.approx(x, abs=radius / 2)
        assert np.median(rows) == pytest.approx(y, abs=radius / 2)


@pytest.mark.long
def test_arrows_show_only_during_contact(drawn: Draw) -> None:
    run = drawn("stack")
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    assert set(motion.forces.mode.tolist()) == {STICK}
    [resting] = take(run, [2])
    assert greenish(resting).sum() > 20
    [falling] = take(drawn("ball"), [0])
    assert not greenish(falling).any()


@pytest.mark.long
def test_an_arrow_is_as_long_as_its_bar_says(drawn: Draw) -> None:
    """An arrow across the view; its tip, a twentieth of its length, is too thin to tell."""
    run, azimuth = drawn("ball"), np.radians(120)
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    across = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    force = across * 0.9 * motion.radius / motion.scale
    start = motion.centre - 0.7 * motion.radius * across
    one = ContactForces(
        *(np.array([0]), np.array([0]), np.array([STICK], np.int8)),
        *(start[None], force[None]),
    )
    motion, size = replace(motion, forces=one), (640, 480)
    [picture] = draw_pictures(run.model, motion, {0: run.trace.qpos[0]}, size)
    columns = np.nonzero(greenish(picture).any(axis=0))[0]
    shown, pixels = force_bar(run.model, motion.stage, size, motion.scale)
    expected = float(np.linalg.norm(force)) * pixels / shown
    assert np.ptp(columns) == pytest.approx(expected, rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("scale", [1e-6, 3e-4, 0.02, 5.0])
def test_bars_are_of_round_forces_and_of_a_fair_length(drawn: Draw, scale: float) -> None:
    run = drawn("ball")
    stage = read_motion(run.start.prepared_model, run.trace, 60).stage
    force, pixels = force_bar(run.model, stage, (640, 480), scale)
    assert f"{force:.0e}"[0] in "125"
    # A fifth of the width, or the next round number below, which is at most 2.5 times less.
    assert 640 / 5 / 2.5 - 1 <= pixels <= 640 / 5 + 1


@pytest.mark.long
def test_the_camera_follows_the_pair_and_the_whole_is_an_inset(drawn: Draw) -> None:
    run = drawn("ball")
    far = run.trace.qpos.copy()
    far[:, 0] += np.linspace(0, 2, len(far))
    motion = read_motion(run.start.prepared_model, replace(run.trace, qpos=far), 60)
    followed = follow_body(motion, [0, 1])
    assert followed is not None
    chosen = {frame: far[motion.rows[frame]] for frame in (0, 6, 12)}
    seen = list(draw_pictures(run.model, followed, chosen, SIZE))
    whole = list(draw_pictures(run.model, motion, chosen, SIZE))
    for near, all_of_it in zip(seen, whole, strict=True):
        blue = bluish(near)
        blue[: SIZE[1] // 3, SIZE[0] // 2 :] = False  # the inset
        rows, columns = np.nonzero(blue)
        assert np.median(columns) == pytest.approx(SIZE[0] / 2, abs=4)
        assert np.median(rows) == pytest.approx(SIZE[1] / 2, abs=6)
        assert blue.sum() > 5 * bluish(all_of_it).sum()
    assert follow_body(read_motion(run.start.prepared_model, run.trace, 60), [0]) is None


@pytest.mark.long
def test_runs_beside_each_other_are_seen_from_one_place(drawn: Draw, target: Target) -> None:
    run = drawn("slide")
    options = PictureOptions(SIZE, other_run=run.run, at=(0.0, 0.2))
    render_run(run.store, run.run, target(".png"), options)
    with Image.open(target(".png")) as image:
        sheet = np.asarray(image)
    assert sheet.shape[1] == 2 * SIZE[0]
    np.testing.assert_array_equal(sheet[:, : SIZE[0]], sheet[:, SIZE[0] :])


@pytest.mark.parametrize(("geoms", "shaded"), [(9, True), (10, False)])
def test_shadows_of_many_triangles_are_left_out(geoms: int, *, shaded: bool) -> None:
    """A ball of four subdivisions has 5,120 triangles, each time that it is drawn."""
    balls = '<geom type="mesh" mesh="ball"/>' * geoms
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><mesh name="ball" builtin="sphere" params="4"/></asset><worldbody>'
        f"<light/>{balls}</worldbody></mujoco>"
    )
    set_looks(model, SIZE)
    assert bool(model.light_castshadow[0]) is shaded
    assert (model.vis.quality.offsamples > 0) is shaded


def test_the_shorter_of_two_films_keeps_its_last_picture() -> None:
    def film(values: list[int]) -> Iterator[Picture]:
        return iter([np.full((2, 2, 3), value, np.uint8) for value in values])

    seen = [(each[0, 0, 0], each[0, -1, 0]) for each in side_by_side(film([1, 2, 3]), film([7]))]
    assert seen == [(1, 7), (2, 7), (3, 7)]


@pytest.mark.long
def test_what_was_recorded_is_a_ghost_where_it_is_elsewhere(drawn: Draw) -> None:
    """Where it is as simulated, or was not recorded, the picture is the same to the last bit."""
    run = drawn("ball")
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    here = run.trace.qpos[motion.rows[0]]
    beside = here + np.eye(len(here))[0] * 0.1

    def picture(recorded: dict[int, Any]) -> Picture:
        return next(draw_pictures(run.model, motion, {0: here}, SIZE, None, recorded))

    def orange(shown: Picture) -> int:
        return int((shown[..., 0].astype(int) - shown[..., 2] > 45).sum())

    plain = picture({})
    assert orange(plain) == 0
    assert orange(picture({0: beside})) > 20
    for same in (here, np.full(len(here), np.nan)):
        assert (picture({0: same}) == plain).all()


@pytest.mark.long
def test_ghosts_are_at_the_nearest_row() -> None:
    times, qpos = np.array([[0.0, 0.1, 0.2, np.nan]]), np.arange(4.0).reshape(1, 4, 1)
    none = np.full((1, 2), -1)
    motion = RecordedMotion((), times, qpos, qpos, np.zeros(1), none, np.zeros(1))
    found = recorded_poses(motion, np.array([0.0, 0.12, 0.19, 5.0]))
    assert {frame: row.item() for frame, row in found.items()} == {0: 0, 1: 1, 2: 2, 3: 2}
    assert recorded_poses(None, np.zeros(3)) == {}


@pytest.mark.long
def test_an_unknown_camera_is_refused(drawn: Draw) -> None:
    with pytest.raises(SceneError, match="the model has no camera 'front'; leave --camera out"):
        take(drawn("ball"), [0], "front")


@pytest.mark.long
def test_a_camera_of_the_model_is_used(drawn: Draw) -> None:
    run = drawn("ball")
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <camera name="front" pos="0 -1 0.1" xyaxes="1 0 0 0 0 1"/>
        <camera name="away" pos="0 -1 0.1" xyaxes="-1 0 0 0 0 1"/>
        <body><freejoint/><geom size="0.05" rgba="0.2 0.4 0.8 1"/></body>
        </worldbody></mujoco>"""
    )
    motion = read_motion(run.start.prepared_model, run.trace, 60)
    for camera, seen in (("front", True), ("away", False)):
        [picture] = draw_pictures(model, motion, {0: run.trace.qpos[0]}, SIZE, camera)
        assert bluish(picture).any() == seen


@pytest.mark.night
@pytest.mark.parametrize("speed", [None, 0.25])
def test_films_last_as_long_as_the_run(drawn: Draw, target: Target, speed: float | None) -> None:
    run, path = drawn("ball"), target(".mp4")
    render_run(run.store, run.run, path, PictureOptions(SIZE, speed=speed))
    seconds = run.trace.time[-1] / (speed or 1)
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
        assert stream.average_rate == 30
        assert (stream.width, stream.height % 2) == (SIZE[0], 0)
    assert len(frames) == int(seconds * 30 + 1e-6) + 1
    [first] = take(run, [0])
    # Compression changes single pixels, not the picture.
    assert np.abs(frames[0][: SIZE[1]].astype(float) - first).mean() < 4


@pytest.mark.long
def test_animations_last_as_long_as_the_run(drawn: Draw, target: Target) -> None:
    run, path = drawn("ball"), target(".gif")
    render_run(run.store, run.run, path, PictureOptions(SIZE))
    with Image.open(path) as animation:
        lasting = 0
        for frame in range(getattr(animation, "n_frames", 0)):
            animation.seek(frame)
            lasting += animation.info["duration"]
        assert animation.info["loop"] == 0
    assert lasting == 80 * (int(run.trace.time[-1] * 12.5 + 1e-6) + 1)


@pytest.mark.long
def test_a_film_of_many_geoms_lasts_as_long_with_fewer_pictures(drawn: Draw) -> None:
    run = drawn("ball")
    start, motion = run.start, read_motion(run.start.prepared_model, run.trace, 60)
    film = RunPictures(start, motion, run.trace.qpos[motion.rows], SIZE, None, {}, {})
    whole = [*film.draw_film(20)]
    most = run.model.ngeom * len(whole) / 3.5  # so each picture is held for 4
    for place, (seen, held) in enumerate(
        zip(film.draw_film(20, most), repeat_every(whole, 4), strict=True)
    ):
        assert (seen == held).all(), place


def repeat_every(pictures: list[Picture], count: int) -> list[Picture]:
    """Return the pictures, each that is no multiple of a count replaced by the last that is."""
    return [pictures[place - place % count] for place in range(len(pictures))]


@pytest.mark.long
def test_a_sheet_has_a_picture_for_each_moment(drawn: Draw, target: Target) -> None:
    run, path = drawn("ball"), target(".png")
    render_run(run.store, run.run, path, PictureOptions(SIZE, at=(0.1, 0.0, 0.1, 0.2)))
    with Image.open(path) as image:
        sheet = np.asarray(image)
    height, width = sheet.shape[0] // 2, SIZE[0]
    assert sheet.shape[1] == 3 * width
    cells = [sheet[:height, place * width : (place + 1) * width] for place in range(3)]
    np.testing.assert_array_equal(cells[0], cells[2])
    assert (cells[0] != cells[1]).any()
    [first] = take(run, [0])
    np.testing.assert_array_equal(cells[1][: SIZE[1]], first)


@pytest.mark.long
def test_equal_runs_give_equal_pictures(drawn: Draw, target: Target) -> None:
    run = drawn("slide")
    contents: list[bytes] = []
    for _ in range(2):
        render_run(run.store, run.run, target(".png"), PictureOptions(SIZE))
        contents.append(target(".png").read_bytes())
    assert contents[0] == contents[1]


@pytest.mark.long
def test_pictures_do_not_depend_on_what_memory_held(
    drawn: Draw, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scene is not cleared when it is made: it may hold what other pictures left there."""
    make, seen = mujoco.MjvScene, list[Picture]()
    for left in (0, mujoco.mjtCatBit.mjCAT_STATIC.value, mujoco.mjtCatBit.mjCAT_DECOR.value):

        def used_before(*given: Any, left: int = left) -> mujoco.MjvScene:
            scene = make(*given)
            for geom in scene.geoms[:100]:
                geom.category = geom.objtype = geom.segid = left
            return scene

        monkeypatch.setattr(mujoco, "MjvScene", used_before)
        seen += take(drawn("slide"), [2])
    assert (seen[0] == seen[1]).all()
    assert (seen[0] == seen[2]).all()


@pytest.mark.long
def test_films_drawn_by_turns_are_as_drawn_alone(drawn: Draw) -> None:
    """Also when one ends or is given up before the other: what OpenGL holds is numbered alike."""
    run = drawn("slide")
    motion = read_motion(run.start.prepared_model, run.trace, 60)

    def film(count: int) -> Generator[Picture]:
        chosen = {frame: run.trace.qpos[motion.rows[frame]] for frame in range(count)}
        return draw_pictures(run.model, motion, chosen, SIZE)

    alone = list(film(4))
    given_up = film(4)
    next(given_up)
    by_turns = [*zip_longest(film(2), film(4)), given_up.close()]
    for count, index in ((2, 0), (4, 1)):
        seen = [each[index] for each in by_turns[:count] if each]
        np.testing.assert_array_equal(seen, alone[:count])
    rest = film(4)
    other = [next(rest), given_up.close(), *rest]
    np.testing.assert_array_equal([each for each in other if each is not None], alone)


def test_a_model_without_geoms_has_no_pictures() -> None:
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    text = f"<mujoco><worldbody><body><joint/>{inertial}</body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    motion: Any = None
    with pytest.raises(SceneError, match="no body of the model has a geom"):
        next(draw_pictures(model, motion, {}, (8, 8)))


@pytest.mark.long
def test_missing_graphics_name_a_remedy(
    drawn: Draw, target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr("ctypes.util.find_library", lambda _: None)
    run = drawn("ball")
    with pytest.raises(SceneError, match=r"no OpenGL to draw with; install .* libosmesa6") as said:
        render_run(run.store, run.run, target(".mp4"))
    assert said.value.exit_code == 2
    assert list(target("").parent.iterdir()) == []


@pytest.mark.long
def test_a_full_disk_leaves_no_half_film(drawn: Draw, tmp_path: Path) -> None:
    run, folder = drawn("ball"), tmp_path / "taken.mp4"
    folder.mkdir()
    with pytest.raises(OutputError, match=r"cannot write .*taken\.mp4: Is a directory"):
        render_run(run.store, run.run, folder, PictureOptions(SIZE))
    assert list(tmp_path.iterdir()) == [folder]
