"""Toggles of effects, the runs of toggled configurations, and their lines in YAML."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.run.evidence_record import as_written
from contactlab.scene.effects.effect import Effect, EffectState
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.store.finished_store import Store
from contactlab.studies.configuration_runs import ConfigurationRows, Row, run_configurations
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.session import Session, Values

States = Mapping[str, EffectState]  # the state of every effect in a run, by name


class Toggle(NamedTuple):
    """One effect, whether it is on in the base configuration, and axis values that toggle it.

    The proof says why results do not depend on it, if that is known without a run.
    """

    effect: str
    on: bool
    values: Values
    proof: str | None


def find_toggles(setup: AblationSetup) -> tuple[Toggle, ...]:
    """Return a toggle of every effect that can be toggled in the base configuration."""
    written, proven = list(_choices(setup, "all")), list(_choices(setup, "auto"))
    toggles = (_toggle(each, written, proven) for each in EFFECTS.values() if each.studied)
    return tuple(filter(None, toggles))


def _choices(setup: AblationSetup, rest: str) -> Iterator[States]:
    scene = setup.scene.with_effects(rest)
    for scenario in setup.scenarios:
        run = scene.resolve({**setup.base, **scenario}, setup.seeds[0], setup.duration)
        yield scene.prepare(run, scene.starts([run])).effects


def _toggle(effect: Effect, written: list[States], proven: list[States]) -> Toggle | None:
    name = effect.name
    if not any(each[name].on for each in written):
        return Toggle(name, False, effect.on, None) if effect.on else None
    unused = not any(each[name].on for each in proven)
    proof = proven[0][name].reason if unused and written[0][name].on else None
    return Toggle(name, True, effect.off or {name: False}, proof)


def settings_sweep(settings: Values, proven: Iterable[str]) -> tuple[str, ...]:
    """Return the lines of a sweep file for settings of toggles; `auto` sees to proven ones."""
    switched = {
        name: value
        for name, value in settings.items()
        if isinstance(value, bool) and name not in set(proven)
    }
    axes = {name: value for name, value in settings.items() if not isinstance(value, bool)}
    words = ["base: auto", *(f"{name}: {str(value).lower()}" for name, value in switched.items())]
    lines = [f"effects: {{{', '.join(words)}}}"]
    if axes:
        lines.append("axes:")
        lines += [f"  {name}: [{as_written(value)}]" for name, value in axes.items()]
    return tuple(lines)


Changed = tuple[str, ...]
"""A configuration: the sorted effects that it toggles in the base configuration."""

BASE: Changed = ()


MOTION = "motion"
"""Where joints are over time: (N, nq) qpos in shares of limited ranges, of others in m or rad."""
_MOST_STATES = 500


def _motion(store: Store, run: str, model: mujoco.MjModel) -> Row:
    """Return the motion of a run at about 500 times, the same in all runs of as many steps."""
    ranges, limited, record = np.ones(model.nq), model.jnt_limited == 1, store.record(run)
    ranges[model.jnt_qposadr[limited]] = np.ptp(model.jnt_range[limited], axis=1)
    qpos = store.trace(record).qpos if record.trace else np.zeros((0, model.nq))
    return {MOTION: qpos[:: max(1, len(qpos) // _MOST_STATES)] / ranges}


_PAIRS = 6  # matched pairs that are timed; their range contains the median in 97 of 100 cases


@dataclass
class ConfigurationRunner:
    """Runs configurations, each set in a store of its own."""

    setup: AblationSetup  # the base configuration, scenarios and seeds
    toggles: Mapping[str, Toggle]
    session: Session
    rounds: int | None  # of a timing pass; None for no timing
    stores: list[str] = field(default_factory=list[str])  # names of the stores written

    def run(
        self,
        name: str,
        description: str,
        configurations: Sequence[Changed],
        setup: AblationSetup | None = None,
        *,
        timed: bool = False,
    ) -> dict[Changed, ConfigurationRows]:
        """Run configurations, with another setup if given; if timed, interleaved."""
        setup = setup or self.setup
        moved = not (setup.tolerances or timed)
        asked = {
            "description": description,
            "tolerances": dict(setup.tolerances),
            "timing": {"rounds": self.rounds} if timed and self.rounds else None,
            "trace": "all" if moved else "none",
        }
        values = [
            {name: value for each in changed for name, value in self.toggles[each].values.items()}
            for changed in configurations
        ]
        measure = {"measure": _motion} if moved else {}
        found = run_configurations(self.session, setup, name, values, asked, **measure)
        self.stores.append(name)
        return dict(zip(configurations, found, strict=True))

    def timed(
        self, name: str, configurations: Sequence[Changed], seeds: Sequence[int] = ()
    ) -> dict[Changed, ConfigurationRows]:
        """Time configurations, interleaved, in at most six matched pairs of each with the base."""
        if self.rounds is None:
            return dict.fromkeys(configurations, ConfigurationRows((), ()))
        scenarios = self.setup.scenarios
        scenarios = scenarios[:: max(1, len(scenarios) // _PAIRS)][:_PAIRS]
        seeds = tuple(seeds or self.setup.seeds)[: max(1, _PAIRS // len(scenarios))]
        setup = replace(self.setup, seeds=seeds, scenarios=scenarios)
        return self.run(name, "Configurations timed in turns", configurations, setup, timed=True)
