"""Search for the cheapest feasible configuration, by few runs.

Integrator and timestep interact, so they are searched together: each integrator for its longest
feasible step, by bisection, as long as it can still win, since time goes as 1 / timestep. Then come
all other knobs, each alone, and those that help together; last what saves time and misses by
little, with a second change. Feasibility at one timestep is taken to imply it at shorter ones; what
is recommended is run again.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from contactlab.schema.setting_values import as_number
from contactlab.studies.session import Values

GAIN = 0.95  # a change helps if it takes at most this share of the time; less is noise
_NEAR = 2.0  # excess up to which another change may be what is missing
_Key = tuple[tuple[str, str], ...]
_Timed = tuple[float, Values]  # a time, over that of the best so far, and what takes it


@dataclass(frozen=True)
class Knob:
    """A setting, or several that go together, and the values to try beside those it has."""

    name: str
    values: tuple[Values, ...]


@dataclass(frozen=True)
class Space:
    """Space of configurations that a search goes through."""

    written: Values  # the values that the model has
    timesteps: tuple[float, ...]  # ascending, that of the model among them [s]
    integrators: tuple[str, ...]  # that of the model among them
    knobs: tuple[Knob, ...]  # all others
    # What is changed before the timestep is, since it makes all that follows slow.
    first: tuple[Knob, ...] = ()


Judge = Callable[[Sequence[Values]], Sequence[float]]
"""Returns by what factor each configuration exceeds the limit that it exceeds most.

It is feasible up to 1; what fails is infinite.
"""
Clock = Callable[[Sequence[Values]], Sequence[float]]
"""Returns the time of each configuration, in any one unit."""


@dataclass
class Search:
    """A search, which may end early: `here` is always the best feasible configuration so far."""

    space: Space
    judge: Judge
    clock: Clock
    # The excess of every configuration that was judged.
    excess: dict[_Key, float] = field(default_factory=dict[_Key, float])
    gain: float = 1.0  # by what factor the knobs that were changed change the time
    here: Values = field(default_factory=dict[str, object])
    needed: set[str] = field(default_factory=set[str])  # what was changed to be feasible

    def run(self) -> None:
        """Search from the model as written; where nothing is feasible, `here` stays as it is."""
        self.here = dict(self.space.written)
        start = self._feasible(self.here)
        if start is None:
            return
        self.here = start
        self.needed = {name for name, value in start.items() if value != self.space.written[name]}
        self._improve(self.space.first)
        while self._improve(self.space.knobs) or self._exchange():
            pass

    def sharpen(self) -> None:
        """Go to the most accurate configuration with the knobs found, at the price as written."""
        written, tried = self.space.written, [self.here]
        time = self._cost(str(written["integrator"]), as_number(written["timestep"])) / self.gain
        for integrator in self.space.integrators:
            fast = [step for step in self.space.timesteps if self._cost(integrator, step) <= time]
            tried += [self._at(integrator, step) for step in fast[:1]]
        excess = self._judged(tried)
        self.here = tried[excess.index(min(excess))]

    def longer(self, rungs: int) -> Values:
        """Return what is found with a step that is so many rungs longer; shorter if negative."""
        place = self.space.timesteps.index(self._step) + rungs
        last = len(self.space.timesteps) - 1
        return {**self.here, "timestep": self.space.timesteps[min(max(place, 0), last)]}

    def _judged(self, configurations: Sequence[Values]) -> list[float]:
        new = {
            key_of(configuration): configuration
            for configuration in configurations
            if math.isnan(self._known(configuration))
        }
        if new:
            self.excess |= zip(new, self.judge(list(new.values())), strict=True)
        return list(map(self._known, configurations))

    def _known(self, values: Values) -> float:
        """Return the excess of a configuration, or of the same with a shorter step that fails."""
        steps = [
            timestep
            for timestep in self.space.timesteps
            if timestep < as_number(values["timestep"])
        ]
        shorter = (self.excess.get(key_of({**values, "timestep": step}), 0.0) for step in steps)
        failed = next((excess for excess in shorter if excess > 1), math.nan)
        return self.excess.get(key_of(values), failed)

    def _kept(self, configurations: Sequence[Values]) -> list[Values]:
        """Return those that are feasible."""
        judged = zip(configurations, self._judged(configurations), strict=True)
        return [settings for settings, excess in judged if excess <= 1]

    def _feasible(self, start: Values) -> Values | None:
        """Return a feasible configuration, from a start on; None if there seems to be none.

        Knobs are changed one by one, the best first, at the shortest step if that helps; last
        that which makes it feasible and takes the least time.
        """
        (best,) = self._judged([start])
        if best > 1:
            shortest = {**start, "timestep": self.space.timesteps[0]}
            (excess,) = self._judged([shortest])
            if excess < GAIN * best:
                best, start = excess, shortest
        while best > 1:
            others = [{**start, "integrator": integrator} for integrator in self.space.integrators]
            others = [*self._changes(start, self.space.knobs), *others]
            if kept := self._kept(others):
                times = self.clock(kept)
                return kept[times.index(min(times))]
            excess = self._judged(others)
            least = min(excess, default=math.inf)
            if not least < best:
                return None
            best, start = least, others[excess.index(least)]
        return start

    def _changes(self, here: Values, knobs: Sequence[Knob]) -> Iterator[Values]:
        """Yield what differs from a configuration in one knob."""
        for knob in knobs:
            own = {name: self.space.written[name] for value in knob.values for name in value}
            for value in (*knob.values, own):
                if {**here, **value} != here and not self.needed & value.keys():
                    yield {**here, **value}

    def _cost(self, integrator: str, timestep: float) -> float:
        return (4.0 if integrator == "RK4" else 1.0) / timestep  # it evaluates forces four times

    @property
    def _step(self) -> float:
        return as_number(self.here["timestep"])

    def _at(self, integrator: str, timestep: float) -> Values:
        return {**self.here, "integrator": integrator, "timestep": timestep}

    def _lengthen(self) -> None:
        """Find the longest feasible step of each integrator that can win, one probe each at a time.

        The first probe is the shortest step that would win, which most do not take; then the rest
        is halved. `here` becomes the cheapest of them.
        """
        steps, integrators = self.space.timesteps, self.space.integrators
        failed, own = dict.fromkeys(integrators, len(steps)), str(self.here["integrator"])
        longest, begun = {own: steps.index(self._step)}, {own} if self.needed else set[str]()
        while True:
            cost = {
                integrator: self._cost(integrator, steps[rung])
                for integrator, rung in longest.items()
            }
            best = min(cost, key=lambda integrator: cost[integrator])
            self.here = self._at(best, steps[longest[best]])
            probes: dict[str, int] = {}
            for integrator in integrators:
                untried = range(longest.get(integrator, -1) + 1, failed[integrator])
                wins = [r for r in untried if self._cost(integrator, steps[r]) < GAIN * cost[best]]
                if wins:
                    probes[integrator] = wins[len(wins) // 2] if integrator in begun else wins[0]
            begun |= probes.keys()
            if not probes:
                return
            tried = [self._at(integrator, steps[rung]) for integrator, rung in probes.items()]
            for (integrator, rung), excess in zip(probes.items(), self._judged(tried), strict=True):
                (longest if excess <= 1 else failed)[integrator] = rung

    def _improve(self, knobs: Sequence[Knob]) -> bool:
        """Change the knobs that save time, then the step; return whether others may save some now.

        They may after a longer step, and of half the time: a small share is twice as large then.
        """
        before, base = self._step, self.here
        helpful = self._faster(self._kept(list(self._changes(base, knobs))))
        if helpful:  # as far as it gets, should the search end now
            self.here = helpful[0][1]
        gain, self.here = self._together(base, helpful)
        self.gain *= gain
        self._lengthen()
        return self._step != before or gain < 0.5

    def _exchange(self) -> bool:
        """Make two changes, of which the first saves time and misses by little; return whether."""
        near = [self.longer(1), *self._changes(self.here, self.space.knobs)]
        for _, first in self._faster(
            [settings for settings in near if 1 < self._known(settings) <= _NEAR]
        ):
            both = [
                change for change in self._changes(first, self.space.knobs) if change != self.here
            ]
            if faster := self._faster(self._kept(both)):
                self.here = faster[0][1]
                return True
        return False

    def _faster(self, configurations: Sequence[Values]) -> list[_Timed]:
        """Return those that save time, over that of `here`, the fastest first."""
        if not configurations:
            return []
        now, *times = self.clock([self.here, *configurations])
        timed = zip((time / now for time in times), configurations, strict=True)
        return sorted((entry for entry in timed if entry[0] < GAIN), key=lambda entry: entry[0])

    def _together(self, base: Values, helpful: Sequence[_Timed]) -> _Timed:
        """Return a base with the changes that are feasible together, of those that help.

        What helps no more once those before it are made is left as it is.
        """
        taken: list[Values] = []
        sums = [base]
        for _, settings in helpful:
            change = {name: value for name, value in settings.items() if value != base[name]}
            if all(sums[-1][name] == base[name] for name in change):
                taken.append(change)
                sums.append({**sums[-1], **change})
        while taken and self._judged(sums[-1:])[0] > 1:
            taken.pop()
            sums.pop()
        if not taken:
            return 1.0, base
        times = [1.0, helpful[0][0]] if len(taken) == 1 else self.clock(sums)
        gain, here = 1.0, base
        for change, before, after in zip(taken, times, times[1:], strict=False):
            if after < GAIN * before:
                gain, here = gain * after / before, {**here, **change}
        return gain, here


def key_of(values: Values) -> _Key:
    """Return what tells a configuration from others."""
    return tuple(sorted((name, str(value)) for name, value in values.items()))
