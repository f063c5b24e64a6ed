"""A film of a grip: the hand closes, and the object is loaded, shaken and pulled."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.studies.grip.holding import inputs_of_pull, inputs_of_shake
from contactlab.studies.grip.judging import worst_of
from contactlab.studies.grip.remedies import Grip
from contactlab.studies.grip.rollouts import constant, states_along
from contactlab.view.state_film import RATES, SIZE, Chapter, check_film, write_states


def filming(
    target: Path, size: tuple[int, int] = SIZE, rate: int | None = None
) -> Callable[[Grip], None]:
    """Return what films a grip into a file, once the file is known to be one that can be written.

    Args:
        target: the file.
        size: in pixels.
        rate: pictures a second; what films of its ending have by default.

    Raises:
        OutputError: its ending is no film's, or what films need is not installed.
    """
    check_film(target)
    shown = rate or RATES[target.suffix.lower()]

    def film(grip: Grip) -> None:
        model = grip.rig.model.__copy__()
        model.site_rgba[:, 3] = 0  # marks of programs, as of where to grip
        chapters = list(_chapters(grip, shown))
        write_states(target, model, chapters, grip.rig.body, size=size, rate=shown)

    return film


def _chapters(grip: Grip, rate: int) -> Iterator[Chapter]:
    model, held = grip.rig.model, grip.held
    every = max(1, round(1 / (rate * model.opt.timestep)))
    row = held.row.copy()
    worst = worst_of(grip.drifts())
    steps = round(worst.seconds / model.opt.timestep)
    way = grip.ways().get(worst.name, np.zeros(3))
    loaded = grip.load.forces(grip.load.gravity * way) if way.any() else np.zeros((model.nbody, 6))
    parts: list[tuple[str, Floats]] = [
        (f"its weight pulls {worst.name}", constant(loaded, 1, steps)[0]),
        (
            "shaken, 5 m/s2 at 5 Hz",
            inputs_of_shake(grip.rig, held, grip.load, grip.load.gravity * way),
        ),
        ("pulled", inputs_of_pull(grip.rig, held, grip.load, grip.ways()[grip.names[0]])),
    ]
    if grip.closing is not None:
        yield Chapter("closing", _closing(grip, every))
    for words, forces in parts:
        controls = constant(held.control, 1, len(forces))[0]
        yield Chapter(words, states_along(model, row, controls, forces, every))


def _closing(grip: Grip, every: int) -> Floats:
    """Return the states of the fingers as they close, whose velocities do not matter to a film."""
    model, path = grip.rig.model, grip.held.path[::every]
    rows = np.repeat(grip.held.row[None], len(path), axis=0)
    time = 1  # mjSTATE_INTEGRATION begins with the time, which qpos follows
    rows[:, time : time + model.nq] = path
    return rows
