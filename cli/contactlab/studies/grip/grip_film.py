"""A film of a grip: the hand closes, and the object is loaded, shaken and pulled."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.studies.grip.grip_fixes import Grip
from contactlab.studies.grip.grip_verdict import worst_drift
from contactlab.studies.grip.holding import pull_forces, shake_forces
from contactlab.studies.grip.rollouts import repeat_input, states_along
from contactlab.view.state_film import RATES, SIZE, Chapter, check_film, write_states


def film_writer(
    target: Path, size: tuple[int, int] = SIZE, rate: int | None = None
) -> Callable[[Grip], None]:
    """Check that a film can be written, and return a function that films a grip.

    Args:
        target: the file.
        size: in pixels.
        rate: frames per second; default for the file type.

    Raises:
        OutputError: the file type is not a film, or a required package is not installed.
    """
    check_film(target)
    frame_rate = rate or RATES[target.suffix.lower()]

    def film(grip: Grip) -> None:
        model = grip.fixture.model.__copy__()
        model.site_rgba[:, 3] = 0  # hides markers of programs, such as grasp points
        chapters = list(_film_chapters(grip, frame_rate))
        write_states(target, model, chapters, grip.fixture.body, size=size, rate=frame_rate)

    return film


def _film_chapters(grip: Grip, rate: int) -> Iterator[Chapter]:
    model, squeeze = grip.fixture.model, grip.squeeze
    every = max(1, round(1 / (rate * model.opt.timestep)))
    row = squeeze.row.copy()
    worst = worst_drift(grip.measure_drifts())
    steps = round(worst.seconds / model.opt.timestep)
    way = grip.directions().get(worst.name, np.zeros(3))
    loaded = (
        grip.load.load_forces(grip.load.gravity * way) if way.any() else np.zeros((model.nbody, 6))
    )
    parts: list[tuple[str, Floats]] = [
        (f"its weight pulls {worst.name}", repeat_input(loaded, 1, steps)[0]),
        (
            "shaken, 5 m/s2 at 5 Hz",
            shake_forces(grip.fixture, squeeze, grip.load, grip.load.gravity * way),
        ),
        ("pulled", pull_forces(grip.fixture, squeeze, grip.load, grip.directions()[grip.names[0]])),
    ]
    if grip.closing is not None:
        # States of closing fingers lack velocities, which a film does not show.
        path = squeeze.path[::every]
        rows = np.repeat(squeeze.row[None], len(path), axis=0)
        time = 1  # mjSTATE_INTEGRATION begins with the time, then qpos
        rows[:, time : time + model.nq] = path
        yield Chapter("closing", rows)
    for words, forces in parts:
        controls = repeat_input(squeeze.control, 1, len(forces))[0]
        yield Chapter(words, states_along(model, row, controls, forces, every))
