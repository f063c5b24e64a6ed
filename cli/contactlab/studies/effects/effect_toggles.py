"""The lines of MJCF and of a sweep file that make a set of effects."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from contactlab.run.evidence_record import as_written
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import ProgressCallback, Stop
from contactlab.scene import EFFECTS, FLAGS, EffectState
from contactlab.store import Store
from contactlab.studies.effects.effects_request import EffectsRequest, Values

_OPTIONS = {
    "elliptic": ("cone", {True: "elliptic", False: "pyramidal"}),
    "noslip": ("noslip_iterations", {True: "3", False: "0"}),
    "implicit": ("integrator", {True: "implicitfast", False: "Euler"}),
}
_AIR = {"density": "0", "viscosity": "0", "wind": "0 0 0"}
_DIMS = {
    "tangential_friction": {True: 3, False: 1},
    "torsional_friction": {True: 4, False: 3},
    "rolling_friction": {True: 6, False: 4},
}
_REMARKS = {
    "sensor": "<!-- remove the elements of <sensor> -->",
    "tendon": "<!-- in <tendon>, set no stiffness, damping, friction loss, armature or range; "
    "remove what no actuator, equality or sensor refers to -->",
}


def mjcf_lines(settings: Values) -> tuple[str, ...]:
    """Return what makes these settings in a model."""
    options = dict(_options(settings))
    flags = {
        name: "enable" if value else "disable"
        for name, value in settings.items()
        if name in FLAGS and isinstance(value, bool)
    }
    return (*_option_lines(options, flags), *_geom_lines(settings), *_remarks(settings))


def sweep_lines(settings: Values, proven: Iterable[str]) -> tuple[str, ...]:
    """Return what makes these settings in a sweep file.

    Args:
        settings: by axis.
        proven: effects that `auto` leaves out by itself.
    """
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


def _options(settings: Values) -> Iterable[tuple[str, str]]:
    for name, value in settings.items():
        if name in _OPTIONS and isinstance(value, bool):
            option, words = _OPTIONS[name]
            yield option, words[value]
        elif name == "air" and value is False:
            yield from _AIR.items()
        elif name == "gravity":
            yield name, "0 0 0"
        elif name == "impratio":
            yield name, str(as_written(value))


def _option_lines(options: Mapping[str, str], flags: Mapping[str, str]) -> list[str]:
    if not flags:
        return [f"<option{_attributes(options)}/>"] if options else []
    head = f"<option{_attributes(options)}>"
    return [head, f"  <flag{_attributes(flags)}/>", "</option>"]


def _geom_lines(settings: Values) -> list[str]:
    bounds = [
        _DIMS[name][value]
        for name, value in settings.items()
        if name in _DIMS and isinstance(value, bool)
    ]
    if not bounds:
        return []
    remark = "<!-- and on every geom and pair that has a condim of its own -->"
    return ["<default>", f'  <geom condim="{min(bounds)}"/> {remark}', "</default>"]


def _remarks(settings: Values) -> list[str]:
    return [text for name, text in _REMARKS.items() if settings.get(name) is False]


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in values.items())


# All that is solved, which pairs of bodies touch, and what inverse dynamics says are the model's.
_KEPT = {"constraint", "filterparent", "invdiscrete"}
# What turns on an effect that the base configuration lacks.
_ON: Mapping[str, Values] = MappingProxyType(
    {
        "torsional_friction": {"torsional_friction": True},
        "rolling_friction": {"rolling_friction": True},
        "elliptic": {"elliptic": True},
        "noslip": {"noslip": True},
        "impratio": {"impratio": 10.0},
        "speculative": {"speculative": True},
        # What sleeps is an island; in a set that leaves islands out, sleep brings them back.
        "sleep": {"sleep": True, "island": True},
        "diagexact": {"diagexact": True},
        "implicit": {"implicit": True},
    }
)
_OFF: Mapping[str, Values] = MappingProxyType(
    {"gravity": {"gravity": 0.0}, "impratio": {"impratio": 1.0}}
)


@dataclass(frozen=True)
class Toggle:
    """One effect, changed.

    Attributes:
        effect: its name.
        on: whether it is on in the base configuration.
        values: axis values that change it.
        proof: why nothing changes with it, if that is known without running anything.
    """

    effect: str
    on: bool
    values: Values
    proof: str | None


def find_toggles(question: EffectsRequest) -> tuple[Toggle, ...]:
    """Return every effect that can be changed, as the base configuration has it."""
    written = [*_choices(question, "all")]
    proven = [*_choices(question, "auto")]
    found = (_toggle(name, written, proven) for name in EFFECTS if name not in _KEPT)
    return tuple(each for each in found if each is not None)


def _choices(question: EffectsRequest, rest: str) -> Iterator[Mapping[str, EffectState]]:
    scene = question.scene.with_effects(rest)
    for scenario in question.scenarios:
        run = scene.resolve({**question.base, **scenario}, question.seeds[0], question.duration)
        yield scene.prepare(run, scene.starts([run])).effects


def _toggle(
    name: str, written: list[Mapping[str, EffectState]], proven: list[Mapping[str, EffectState]]
) -> Toggle | None:
    on = any(each[name].on for each in written)
    if not on:
        return Toggle(name, False, _ON[name], None) if name in _ON else None
    unused = not any(each[name].on for each in proven)
    proof = proven[0][name].reason if unused and written[0][name].on else None
    return Toggle(name, True, _OFF.get(name, {name: False}), proof)


Row = Mapping[str, Any]
# The effects that are changed from the base configuration, sorted.
Changed = tuple[str, ...]
BASE: Changed = ()


@dataclass(frozen=True)
class TrialOutcome:
    """What came of one configuration: rows of the store, by scenario and by seed."""

    rows: tuple[tuple[Row, ...], ...]

    @property
    def flat(self) -> list[Row]:
        """All rows."""
        return [row for rows in self.rows for row in rows]


@dataclass
class TrialRunner:
    """Runs configurations.

    Attributes:
        question: what is asked.
        toggles: every effect that can be changed, by name.
        folder: where the stores go.
        workers: processes.
        begin: told how many runs a store has, and how many of them are done already.
        progress: told of runs as they finish.
        rounds: how often runs are timed, if they are; None for never.
        stop: set when runs should end soon; None if they never should.
        stores: names of the stores written.
    """

    question: EffectsRequest
    toggles: Mapping[str, Toggle]
    folder: Path
    workers: int
    begin: Callable[[int, int], None]
    progress: ProgressCallback
    rounds: int | None
    stop: Stop | None = None
    stores: list[str] = field(default_factory=list[str])

    def run(
        self,
        name: str,
        description: str,
        configurations: Iterable[Changed],
        *,
        seeds: Sequence[int] | None = None,
        scenarios: Sequence[Values] | None = None,
        timed: bool = False,
    ) -> dict[Changed, TrialOutcome]:
        """Run configurations in all scenarios, each from the same seeds.

        Args:
            name: of the store.
            description: what the runs are for.
            configurations: effects that each changes.
            seeds: the question's if None.
            scenarios: the question's if None.
            timed: whether the runs are timed in turns.
        """
        asked = list(dict.fromkeys(configurations))
        seeds = self.question.seeds if seeds is None else seeds
        scenarios = self.question.scenarios if scenarios is None else scenarios
        rows = [[self.values(each, scenario) for scenario in scenarios] for each in asked]
        rounds = self.rounds if timed else None
        text = self._sweep(description, [each for row in rows for each in row], seeds, rounds)
        self._run(name, text)
        table = Store.open(self.folder / name).table
        found = {row["run_id"]: row for row in table.to_pylist()}
        return {
            each: TrialOutcome(
                tuple(tuple(found[self._id(row, seed)] for seed in seeds) for row in of_each)
            )
            for each, of_each in zip(asked, rows, strict=True)
        }

    def _run(self, name: str, text: str) -> None:
        asked = read_request(
            text,
            name,
            self.folder / name,
            folder=self.question.scenes.folder or Path(),
            workers=self.workers,
            fresh=True,
        )
        run_sweep(asked, self.begin, self.progress, self.stop)
        self.stores.append(name)

    def values(self, changed: Changed, scenario: Values) -> Values:
        """Return the axis values of a configuration in a scenario."""
        values = {**self.question.base, **scenario}
        for name in changed:
            values |= self.toggles[name].values
        return values

    def _id(self, values: Values, seed: int) -> str:
        scene = self.question.scene
        return scene.run_id(scene.resolve(values, seed, self.question.duration))

    def _sweep(
        self, description: str, rows: Sequence[Values], seeds: Sequence[int], rounds: int | None
    ) -> str:
        """Return a sweep file; JSON is YAML."""
        question = self.question
        content = {
            "version": 1,
            "scene": question.reference,
            "description": description,
            "duration": question.duration,
            "seeds": list(seeds),
            "include": list(rows),
            "effects": "all",
            "tolerances": dict(question.tolerances),
            "thresholds": dict(question.thresholds),
            "timing": rounds and {"rounds": rounds},
            "trace": "none",
            "checks": "none",
        }
        return json.dumps(
            {key: each for key, each in content.items() if each is not None}, indent=1
        )
