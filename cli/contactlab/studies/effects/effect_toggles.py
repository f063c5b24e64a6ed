"""Effects changed: what changes each, the runs with it, and the lines that make it so."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from contactlab.run.evidence_record import as_written
from contactlab.scene import EFFECTS, FLAGS, EffectState
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.session import Session, Values

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


def find_toggles(setup: AblationSetup) -> tuple[Toggle, ...]:
    """Return every effect that can be changed, as the base configuration has it."""
    written = [*_choices(setup, "all")]
    proven = [*_choices(setup, "auto")]
    found = (_toggle(name, written, proven) for name in EFFECTS if name not in _KEPT)
    return tuple(each for each in found if each is not None)


def _choices(setup: AblationSetup, rest: str) -> Iterator[Mapping[str, EffectState]]:
    scene = setup.scene.with_effects(rest)
    for scenario in setup.scenarios:
        run = scene.resolve({**setup.base, **scenario}, setup.seeds[0], setup.duration)
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
        setup: the base configuration, scenarios and seeds.
        toggles: every effect that can be changed, by name.
        session: where runs go, and how.
        rounds: how often runs are timed, if they are; None for never.
        stores: names of the stores written.
    """

    setup: AblationSetup
    toggles: Mapping[str, Toggle]
    session: Session
    rounds: int | None
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
            seeds: the setup's if None.
            scenarios: the setup's if None.
            timed: whether the runs are timed, interleaved.
        """
        setup, each_once = self.setup, list(dict.fromkeys(configurations))
        seeds = setup.seeds if seeds is None else seeds
        scenarios = setup.scenarios if scenarios is None else scenarios
        rows = [[self._values(each, scenario) for scenario in scenarios] for each in each_once]
        sweep = {
            "version": 1,
            "scene": setup.reference,
            "description": description,
            "duration": setup.duration,
            "seeds": list(seeds),
            "include": [row for of_each in rows for row in of_each],
            "effects": "all",
            "tolerances": dict(setup.tolerances),
            "thresholds": dict(setup.thresholds),
            "timing": {"rounds": self.rounds} if timed and self.rounds else None,
            "trace": "none",
            "checks": "none",
        }
        content = {key: value for key, value in sweep.items() if value is not None}
        table = self.session.run_derived(name, content, setup.scenes).table
        self.stores.append(name)
        runs = {row["run_id"]: row for row in table.to_pylist()}
        return {
            each: TrialOutcome(
                tuple(tuple(runs[self._id(row, seed)] for seed in seeds) for row in of_each)
            )
            for each, of_each in zip(each_once, rows, strict=True)
        }

    def _values(self, changed: Changed, scenario: Values) -> Values:
        """Return the axis values of a configuration in a scenario."""
        values = {**self.setup.base, **scenario}
        for name in changed:
            values |= self.toggles[name].values
        return values

    def _id(self, values: Values, seed: int) -> str:
        scene = self.setup.scene
        return scene.run_id(scene.resolve(values, seed, self.setup.duration))
