"""Search for the cheapest feasible configuration, by few runs.

Integrator and timestep interact, so they are searched together: each integrator for its longest
feasible step, by bisection, as long as it can still win, since time goes as 1 / timestep. Then come
all other knobs, each alone, at that step and at the next longer one, and those that help together.
Feasibility at one timestep is taken to imply it at shorter ones; what is recommended is run again.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from contactlab.scene.setting_values import as_number
from contactlab.studies.session import Values

GAIN = 0.95  # a change helps if it takes at most this share of the time; less is noise
_WEIGHTS = {"RK4": 4.0}
"""Times of a step over those of others, where not known: RK4 evaluates forces four times."""
_Key = tuple[tuple[str, str], ...]
_Timed = tuple[float, Values]  # a time, over that of the best so far, and what takes it


@dataclass(frozen=True)
class Knob:
    """A setting, or several that go together, and the values to try beside those it has."""

    name: str
    values: tuple[Values, ...]


@dataclass(frozen=True)
class Space:
    """What is searched."""

    written: Values  # the values that the model has
    timesteps: tuple[float, ...]  # ascending, that of the model among them [s]
    integrators: tuple[str, ...]  # that of the model among them
    knobs: tuple[Knob, ...]  # all others


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
    # Time of a step by integrator, in any one unit.
    weights: Mapping[str, float] = field(default_factory=dict[str, float])
    # The excess of every configuration that was judged.
    excess: dict[_Key, float] = field(default_factory=dict[_Key, float])
    gain: float = 1.0  # by what factor the knobs that were changed change the time
    here: Values = field(default_factory=dict[str, object])

    def run(self) -> None:
        """Search from the model as written; where nothing is feasible, `here` stays as it is."""
        self.here = dict(self.space.written)
        start = self._feasible(self.here)
        if start is None:
            return
        self.here = start
        self._lengthen()
        while self._improve():
            pass

    def sharpen(self) -> None:
        """Go to the most accurate configuration with the knobs found, at the price as written."""
        written = self.space.written
        time = self._cost(str(written["integrator"]), as_number(written["timestep"]))
        tried = [
            self._at(integrator, fast[0])
            for integrator in self.space.integrators
            if (
                fast := [
                    h for h in self.space.timesteps if self._cost(integrator, h) * self.gain <= time
                ]
            )
        ]
        excess = self._judged([self.here, *tried])
        self.here = [self.here, *tried][excess.index(min(excess))]

    def longer(self, rungs: int) -> Values:
        """Return what is found with a step that is so many rungs longer; shorter if negative."""
        place = self.space.timesteps.index(self._step) + rungs
        last = len(self.space.timesteps) - 1
        return {**self.here, "timestep": self.space.timesteps[min(max(place, 0), last)]}

    def _judged(self, configurations: Sequence[Values]) -> list[float]:
        new = {key: each for each in configurations if (key := key_of(each)) not in self.excess}
        if new:
            self.excess |= zip(new, self.judge(list(new.values())), strict=True)
        return [self.excess[key_of(each)] for each in configurations]

    def _feasible(self, start: Values) -> Values | None:
        """Return a feasible configuration, from a start on; None if there seems to be none.

        At the shortest step, knobs are changed one by one, the one that helps most first.
        """
        (best,) = self._judged([start])
        if best > 1:
            start = {**start, "timestep": self.space.timesteps[0]}
            (best,) = self._judged([start])
        while best > 1:
            changes = [each for _, each in self._changes(start)]
            changes += [{"integrator": each} for each in self.space.integrators]
            others = [{**start, **each} for each in changes]
            excess = self._judged(others)
            least = min(excess, default=math.inf)
            if not least < best:
                return None
            best, start = least, others[excess.index(least)]
        return start

    def _changes(self, here: Values) -> Iterator[tuple[str, Values]]:
        """Yield the values that single knobs may have beside those of a configuration."""
        for knob in self.space.knobs:
            own = {name: self.space.written[name] for each in knob.values for name in each}
            for each in (*knob.values, own):
                if any(here[name] != value for name, value in each.items()):
                    yield knob.name, each

    def _cost(self, integrator: str, timestep: float) -> float:
        return self.weights.get(integrator, _WEIGHTS.get(integrator, 1.0)) / timestep

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
        failed, begun = dict.fromkeys(integrators, len(steps)), set[str]()
        longest = {str(self.here["integrator"]): steps.index(self._step)}
        while True:
            cost = {each: self._cost(each, steps[rung]) for each, rung in longest.items()}
            best = min(cost, key=lambda each: cost[each])
            self.here = self._at(best, steps[longest[best]])
            probes: dict[str, int] = {}
            for each in integrators:
                untried = range(longest.get(each, -1) + 1, failed[each])
                wins = [r for r in untried if self._cost(each, steps[r]) < GAIN * cost[best]]
                if wins:
                    probes[each] = wins[len(wins) // 2] if each in begun else wins[0]
            begun |= probes.keys()
            if not probes:
                return
            tried = [self._at(each, steps[rung]) for each, rung in probes.items()]
            for (each, rung), excess in zip(probes.items(), self._judged(tried), strict=True):
                (longest if excess <= 1 else failed)[each] = rung

    def _improve(self) -> bool:
        """Change the knobs that save time; return whether the step became longer, too."""
        before, (helpful, jump) = self._step, self._helpful()
        gain, together = self._together(helpful)
        if jump[0] < GAIN * gain:
            self.here = jump[1]
        else:
            self.here, self.gain = together, self.gain * gain
        self._lengthen()
        return self._step != before

    def _helpful(self) -> tuple[list[_Timed], _Timed]:
        """Return the best change of each knob that saves time, the most helpful first.

        And the configuration with one change, and the next longer step, that takes least.
        """
        changes, longer = list(self._changes(self.here)), self.longer(1)["timestep"]
        same = [{**self.here, **each} for _, each in changes]
        long = [{**each, "timestep": longer} for each in same if longer != self._step]
        tried = zip([*same, *long], self._judged([*same, *long]), strict=True)
        feasible = [each for each, excess in tried if excess <= 1]
        if not feasible:
            return [], (1.0, self.here)
        now, *times = self.clock([self.here, *feasible])
        ratio = {key_of(each): time / now for each, time in zip(feasible, times, strict=True)}
        best: dict[str, _Timed] = {}
        for (name, values), each in zip(changes, same, strict=True):
            if ratio.get(key_of(each), 1.0) < best.get(name, (GAIN, values))[0]:
                best[name] = ratio[key_of(each)], values
        jumps = [(ratio[key_of(each)], each) for each in long if key_of(each) in ratio]
        least = min(jumps, key=lambda each: each[0], default=(1.0, self.here))
        return sorted(best.values(), key=lambda each: each[0]), least

    def _together(self, helpful: Sequence[_Timed]) -> _Timed:
        """Return a configuration with the most helpful changes that are feasible together.

        What helps no more once those before it are made is left as it is.
        """
        taken: list[Values] = []
        sums = [self.here]
        for _, change in helpful:
            if all(sums[-1][name] == self.here[name] for name in change):
                taken.append(change)
                sums.append({**sums[-1], **change})
        while taken and self._judged(sums[-1:])[0] > 1:
            taken.pop()
            sums.pop()
        if not taken:
            return 1.0, self.here
        times = [1.0, helpful[0][0]] if len(taken) == 1 else self.clock(sums)
        gain, here = 1.0, self.here
        for change, before, after in zip(taken, times, times[1:], strict=False):
            if after < GAIN * before:
                gain, here = gain * after / before, {**here, **change}
        return gain, here


def key_of(values: Values) -> _Key:
    """Return what tells a configuration from others."""
    return tuple(sorted((name, str(value)) for name, value in values.items()))
