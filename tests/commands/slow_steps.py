"""Run `contactlab` with steps that take long enough to be drawn, and to be interrupted.

The terminal waits after each step that it shows, so that no machine is too quick for a test.
"""

import time
from collections.abc import Sequence

from contactlab.__main__ import main
from contactlab.command_line.terminal import ProgressDisplay, Terminal
from contactlab.run.tasks import FinishedRun
from contactlab.step_progress import StepCount, finished_share

show_steps, advance = Terminal.show_steps, ProgressDisplay.advance


def show_slowly(self: Terminal, nested: Sequence[StepCount]) -> None:
    """Show steps; those with an estimate stay while a reader of the terminal may interrupt them."""
    show_steps(self, nested)
    time.sleep(1.0 if finished_share(nested) else 0.15)


def advance_slowly(self: ProgressDisplay, finished: Sequence[FinishedRun]) -> None:
    """Count runs; a second after the first ones their rate is known, and drawn at the next ones."""
    advance(self, finished)
    if finished:
        time.sleep(1.3)


if __name__ == "__main__":
    Terminal.show_steps, ProgressDisplay.advance = show_slowly, advance_slowly
    main()
