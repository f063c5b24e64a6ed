"""Robots of MuJoCo Menagerie as scenes: `menagerie:ROBOT[/ENTRY]`."""

import importlib
from pathlib import Path
from typing import Any

from contactlab.errors import SceneError, did_you_mean

_SCHEME = "menagerie:"


def is_menagerie(reference: str) -> bool:
    """Say whether a scene's reference names a robot of MuJoCo Menagerie."""
    return reference.startswith(_SCHEME)


def menagerie_name(reference: str) -> str:
    """Return the name of a robot's scene, fit for a file: `franka_emika_panda-panda`."""
    return reference.removeprefix(_SCHEME).replace("/", "-")


def menagerie_model(reference: str) -> Path:
    """Return the model file of a robot, which the package downloads on first use.

    Without an entry it is the robot's default: its scene if it has one.

    Raises:
        SceneError: the package is not installed, knows no such robot or entry, or cannot get it.
    """
    package = _package(reference)
    robot, _, entry = reference.removeprefix(_SCHEME).partition("/")
    found = _robot(package, robot)
    known = found.entry_names
    if entry and entry not in known:
        hint = did_you_mean(entry, known) or f"; write one of {', '.join(known)}"
        raise SceneError(f"{robot} of MuJoCo Menagerie has no entry '{entry}'{hint}")
    try:
        path = Path(found.xml(entry or None))
    except (package.MenagerieError, OSError) as error:
        raise SceneError(
            f"cannot get {robot}: {error}\n"
            "a robot is downloaded once, which takes a network; without one, set MENAGERIE_ROOT to "
            "a folder that holds the robot's, such as a checkout of mujoco_menagerie"
        ) from error
    if not path.is_file():
        raise SceneError(f"{path.parent} holds no {path.name}, the file of '{reference}'")
    return path


def _package(reference: str) -> Any:  # noqa: ANN401 - a module that may not be there
    try:
        return importlib.import_module("mujoco_menagerie")
    except ModuleNotFoundError as error:
        raise SceneError(
            f"'{reference}' takes the package mujoco-menagerie; "
            "install it with `pip install 'contactlab[menagerie]'`"
        ) from error


def _robot(package: Any, name: str) -> Any:  # noqa: ANN401
    known: list[str] = package.names()
    if name not in known:
        hint = did_you_mean(name, known) or "; `mujoco-menagerie names` lists them"
        raise SceneError(f"MuJoCo Menagerie has no robot '{name}'{hint}")
    return package.get(name)
