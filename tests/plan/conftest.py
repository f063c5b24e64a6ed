"""A small scene vocabulary, and a reader of sweep texts that uses it."""

from collections.abc import Callable

import pytest

from contactlab.errors import SceneError
from contactlab.plan.diagnostics import SweepMistakesError
from contactlab.plan.overrides import Overrides
from contactlab.plan.sweep_file import SweepFile, read_sweep
from contactlab.schema.vocabulary import AxisSpec, Vocabulary


def positive(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or value <= 0:
        raise ValueError("write a number above 0")
    return float(value)


def number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError("write a number")
    return float(value)


def whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int | float) or value != int(value):
        raise ValueError("write a whole number")
    return int(value)


def pair(value: object) -> tuple[float, ...]:
    parts = value.split() if isinstance(value, str) else value
    if not isinstance(parts, list | tuple) or len(parts) != 2:
        raise ValueError("write two numbers")
    return float(parts[0]), float(parts[1])


def switch(value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError("write true or false")
    return value


def one_of(*words: str) -> Callable[[object], str]:
    def parse(value: object) -> str:
        if value not in words:
            raise ValueError(f"write one of {', '.join(words)}")
        return str(value)

    return parse


CONES = ("pyramidal", "elliptic")
INTEGRATORS = ("Euler", "RK4", "implicitfast")
SPECS = (
    AxisSpec("timestep", "s", "step length", positive),
    AxisSpec("solref", "", "contact softness", pair, (), ("solref.timeconst", "solref.dampratio")),
    AxisSpec("solref.timeconst", "s", "time constant", positive),
    AxisSpec("solref.dampratio", "1", "damping ratio", positive),
    AxisSpec("friction.slide", "1", "sliding friction", number),
    AxisSpec("iterations", "1", "solver iterations", whole),
    AxisSpec("cone", "", "friction cone", one_of(*CONES), CONES),
    AxisSpec("integrator", "", "integrator", one_of(*INTEGRATORS), INTEGRATORS),
    AxisSpec("drop_height", "m", "height of the fall", number),
    AxisSpec("multiccd", "", "several contacts a pair", switch),
)


def known(scene: str) -> Vocabulary:
    if scene != "ball":
        raise SceneError(f"no shipped scene named '{scene}'; did you mean 'ball'?\nsee the list")
    axes, metrics = {each.name: each for each in SPECS}, ("penetration_max", "energy_gain")
    return Vocabulary(list(axes), axes.get, metrics, ("stable", "tunneling"))


@pytest.fixture(scope="session")
def vocabulary() -> Callable[[str], Vocabulary]:
    return known


@pytest.fixture(scope="session")
def read() -> Callable[..., SweepFile]:
    """Read the body of a sweep file of the scene `ball`, its first two lines left out."""

    def read_body(body: str = "", **options: object) -> SweepFile:
        overrides = Overrides(**options)  # pyright: ignore[reportArgumentType]
        return read_sweep(f"version: 1\nscene: ball\n{body}", known, overrides)

    return read_body


@pytest.fixture(scope="session")
def mistakes(read: Callable[..., SweepFile]) -> Callable[..., list[tuple[str, str]]]:
    """Return the code and the marked text of every mistake of a body."""

    def of(body: str = "", **options: object) -> list[tuple[str, str]]:
        with pytest.raises(SweepMistakesError) as caught:
            read(body, **options)
        return [
            (each.code, each.place.text[each.place.column - 1 :][: each.place.width])
            for each in caught.value.diagnostics
        ]

    return of
