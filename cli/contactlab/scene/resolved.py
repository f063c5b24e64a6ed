"""Everything that decides one run, in plain values."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from contactlab.scene.effects import EFFECTS, EffectRequest
from contactlab.scene.engine_flags import FLAGS
from contactlab.scene.initial_states import QPOS0


@dataclass(frozen=True, slots=True)
class ResolvedRun:
    """Everything that decides one run's trajectory, but for the scene's own files.

    Attributes:
        structure: structure values, by name.
        settings: every engine and contact setting.
        changed: names of the settings that differ from the model as written.
        flags: every engine switch.
        initial: the scene's initial values.
        seed: what perturbs the start state.
        duration: simulated time [s].
        effect_request: what is asked of its effects.
        without: effects that its model is compiled without.
    """

    structure: Mapping[str, object]
    settings: Mapping[str, object]
    changed: frozenset[str]
    flags: Mapping[str, bool]
    initial: Mapping[str, float]
    seed: int
    duration: float
    effect_request: EffectRequest
    without: frozenset[str]

    @property
    def timestep(self) -> float:
        """Length of a step [s]."""
        return float(str(self.settings["timestep"]))

    @property
    def keyframe(self) -> str:
        """The keyframe to start from, or `QPOS0`."""
        return str(self.settings.get("keyframe", QPOS0))

    @property
    def steps(self) -> int:
        """Steps that cover the duration; at least one."""
        return steps_of(self.duration, self.timestep)

    @property
    def values(self) -> dict[str, Any]:
        """Structure, settings and initial values in one table."""
        return {**self.structure, **self.settings, **self.initial}

    def edits(self) -> dict[str, object]:
        """Return the settings and switches to write into the base model."""
        # Model fields go last: they are more particular than the settings that write them too.
        names = sorted(self.changed & set(self.settings), key=lambda name: ("[" in name, name))
        edits = {name: self.settings[name] for name in names}
        # Gravity is a setting, though there is a switch of that name too.
        switched = sorted(self.changed & set(FLAGS) - set(self.settings))
        edits |= {name: self.flags[name] for name in switched}
        return edits | {name: self.effect_request.asked[name] for name in self._written()}

    def _written(self) -> list[str]:
        """Return the effects asked for that are neither switches nor settings."""
        asked = self.effect_request.asked.keys() - set(FLAGS) - self.without
        return sorted(name for name in asked if EFFECTS[name].turn and name in self.changed)


def steps_of(duration: float, timestep: float) -> int:
    """Return how many steps cover a duration; at least one."""
    return max(1, round(duration / timestep))
