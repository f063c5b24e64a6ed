"""Add engines that can simulate."""

from typing import Annotated

from contactlab.command_line.declaration import Argument, Given, command
from contactlab.command_line.surroundings import say
from contactlab.command_line.terminal import echo
from contactlab.errors import EngineError


def _text(version: str, given: Given) -> None:
    echo(f"{given['name']} {version}")


@command("extend", name="engines add", examples=("engines add bullet",), formats={"text": _text})
def add(name: Annotated[str, Argument("NAME", "Engine to install.")]) -> str:
    """Install an engine in an environment of its own, in the user's cache.

    Its version is returned, and whether it was here.

    Raises:
        EngineError: there is no such engine, or this machine cannot have it.
    """
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine
    from contactlab.run.mujoco_environment import make_environment

    engine = find_engine(name)
    if isinstance(engine, AdaptedEngine) and engine.refused:
        raise EngineError(engine.absence)
    if not isinstance(engine, AdaptedEngine) or engine.version:
        return f"{engine.version} is here"
    say(f"setting up {name} in {engine.environment}, once")
    advice = f"look whether this machine can have {' and '.join(engine.requirements)}"
    make_environment(engine.environment, engine.requirements, name, advice, lambda _: None)
    return engine.version
