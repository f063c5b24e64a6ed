"""Words of a command line with the command that they leave out: a model alone is examined."""

from collections.abc import Sequence
from pathlib import Path

from contactlab.command_line.modules import command_modules
from contactlab.errors import SweepFileError, did_you_mean
from contactlab.resources import scene_names

_EXAMINE = "examine"
_MANIFEST = "manifest.json"
_SWEEPS = {".yaml", ".yml"}


def complete_words(words: Sequence[str]) -> list[str]:
    """Return the words of a command line with its command: `contactlab robot.xml` examines.

    Raises:
        SweepFileError: the first word is neither a command nor a model.
    """
    first = words[0] if words else ""
    if new := replacement_of(first, *words[1:2]):
        raise SweepFileError(f"'{first}' is now `contactlab {new}`")
    if not first or first.startswith("-") or first in command_modules():
        return list(words)
    path = Path(first)
    if path.suffix in _SWEEPS:
        raise SweepFileError(f"{first}: a sweep runs by `contactlab sweep {first}`")
    if (path / _MANIFEST).is_file():
        raise SweepFileError(f"{first}: a store; read it by `contactlab report {first}`")
    is_place = bool(path.suffix) or "/" in first or ":" in first or path.exists()
    if is_place or first in scene_names():
        return [_EXAMINE, *words]
    from contactlab.plugins import find_extensions

    if first not in find_extensions("command"):
        near = did_you_mean(first, [*command_modules(), *scene_names()])
        raise SweepFileError(
            f"no command, model or shipped scene '{first}'{near or '; see contactlab --help'}"
        )
    return list(words)


def replacement_of(command: str, *rest: str) -> str:
    """Return the words that replace a command of an earlier version; empty for other words."""
    new_names = {
        "baseline": "compare BASELINE CANDIDATE --update",
        "check": "examine MODEL --section checks",
        "engines": "parity --closed-forms",
        "merge": "sweep SHARD... --merge -o STORE",
        "replay": "verify STORE RUN",
        "schema": "list schemas",
        "traces": "render STORE -o FOLDER",
    }
    if (command, *rest) == ("engines", "add"):
        return "parity --install NAME"
    return new_names.get(command, "")
