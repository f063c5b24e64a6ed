"""What a scene's subject is held by, and when."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco

from contactlab.errors import SceneError, did_you_mean
from contactlab.expression import Expression
from contactlab.scene.formula import computed, read_formula
from contactlab.schema import SceneManifest

_WORLD = "world"


@dataclass(frozen=True)
class Holding:
    """What a manifest's `hold` says.

    Attributes:
        subject: the body that is held.
        holder: the body that holds it.
        start: from when [s].
        stop: to when [s].
    """

    subject: str
    holder: str
    start: Expression
    stop: Expression

    def window(self, initial: Mapping[str, float]) -> tuple[float, float]:
        """Return when a run of these initial values should hold, from and to [s].

        Raises:
            SceneError: that is no stretch of time.
        """
        start, stop = computed(self.start, initial), computed(self.stop, initial)
        if not 0 <= start < stop:
            raise SceneError(
                f"hold goes from {start:g} s to {stop:g} s for {dict(initial)}; "
                "write a time from 0 on, and a later one"
            )
        return start, stop


def find_holding(
    model: mujoco.MjModel, manifest: SceneManifest | None, subject: int | None
) -> Holding | None:
    """Return what a manifest says of the subject's hold, if it does.

    Raises:
        SceneError: there is no subject or no such holder, or the times are wrong.
    """
    if manifest is None or manifest.hold is None:
        return None
    if subject is None:
        raise SceneError("hold needs to know what is held; name it in `subject`")
    holder = manifest.hold.relative_to or _WORLD
    bodies = [model.body(each).name for each in range(model.nbody)]
    if holder not in bodies:
        hint = did_you_mean(holder, bodies)
        raise SceneError(f"hold: '{holder}' in relative_to is no body of the model{hint}")
    holding = Holding(
        subject=bodies[subject],
        holder=holder,
        start=read_formula(manifest.hold.start, "hold sets its `from`", manifest),
        stop=read_formula(manifest.hold.stop, "hold sets its `to`", manifest),
    )
    _, stop = holding.window({name: each.default for name, each in manifest.initial.items()})
    if stop > manifest.duration:
        raise SceneError(
            f"hold ends at {stop:g} s, after the run, which takes {manifest.duration:g} s"
        )
    return holding
