"""Option rules: impossible values, and gravity that is not in metres."""

from collections.abc import Iterator

import mujoco
import numpy as np

from contactlab.scene.compile_model import wrong_options
from contactlab.scene.model_text import mjcf_text
from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule


@rule("option-value", "gate")
def find_impossible_options(linted: LintedModel) -> Iterator[Fault]:
    """An option is infinite, or zero or negative where nothing in the world is.

    MuJoCo compiles it; other commands refuse it, unless `--set` replaces the value. Fix: MuJoCo's
    default, or the intended value.
    """
    wrong = wrong_options(linted.model)
    if wrong:
        usual = mujoco.MjSpec().option
        values = {name: mjcf_text(np.ravel(getattr(usual, name)).tolist()) for name in wrong}
        yield Fault(
            "; ".join(f"{name} {fault_text}" for name, fault_text in wrong.items()),
            linted.place_of("option"),
            linted.set_in("option", **values),
        )


@rule("gravity-size", "note")
def find_large_gravity(linted: LintedModel) -> Iterator[Fault]:
    """Gravity is ten times the Earth's or more, as in centimetres or millimetres.

    Lengths are read as metres, so limits in mm are of other lengths here. Shares of
    forces are not affected. Fix: none if the unit is meant, otherwise metres.
    """
    size = float(np.linalg.norm(linted.model.opt.gravity))
    large = 100.0  # m/s^2, ten times the Earth's
    if large <= size < np.inf:
        yield Fault(
            f"gravity is {size:g} m/s^2: lengths are read as metres; where they are centimetres or "
            "millimetres, limits in mm and mm/s are of other lengths",
            linted.place_of("option"),
        )
