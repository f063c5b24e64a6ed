"""The words of a command line as people type them: a model alone is examined, old names work."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from contactlab.command_line.modules import command_modules
from contactlab.command_line.terminal import say
from contactlab.errors import SweepFileError, did_you_mean
from contactlab.resources import scene_names

_EXAMINE = "examine"
FORMER: Mapping[str, tuple[str, ...]] = {
    "labels": ("list", "labels"),
    "metrics": ("list", "metrics"),
    "scenes": ("list", "scenes"),
    "sweeps": ("list", "sweeps"),
    "thresholds": ("list", "limits"),
    "engines": ("list", "engines"),
}
"""Names of commands up to 0.3, and the words of today."""
_HELP = ("-h", "--help")
_OF_STORE = "manifest.json"
_SWEEPS = {".yaml", ".yml"}


def completed(words: Sequence[str]) -> list[str]:
    """Return the words of a command line with the command that they leave out, or call otherwise.

    `contactlab robot.xml` examines the model; a command that had another name up to 0.3 is said
    once, and called by its name of today.

    Raises:
        SweepFileError: the first word is neither a command nor a model.
    """
    first = words[0] if words else ""
    if first in FORMER and not _is_of_today(words):
        now = _as_named_now(words)
        say(f"`contactlab {first}` is `contactlab {' '.join(now[:2])}` now; the old name goes next")
        return now
    if not first or first.startswith("-") or first in command_modules():
        return list(words)
    if Path(first).suffix in _SWEEPS:
        raise SweepFileError(f"{first}: a sweep runs by `contactlab sweep {first}`")
    if (Path(first) / _OF_STORE).is_file():
        raise SweepFileError(f"{first}: a store; read it by `contactlab report {first}`")
    if _is_model(first):
        return [_EXAMINE, *words]
    from contactlab.plugins import extensions

    if first not in extensions("command"):
        near = did_you_mean(first, [*command_modules(), *scene_names(), *FORMER])
        raise SweepFileError(
            f"no command, model or shipped scene '{first}'{near or '; see contactlab --help'}"
        )
    return list(words)


def _is_of_today(words: Sequence[str]) -> bool:
    """Return whether words are of the commands `engines add` and its like, or ask about these."""
    first, *rest = words
    return first in command_modules() and bool(rest) and (rest[0] in _HELP or rest[0][:1] != "-")


def _as_named_now(words: Sequence[str]) -> list[str]:
    first, *rest = words
    if first == "scenes" and rest and not rest[0].startswith("-"):
        return ["list", "axes", *rest]
    return [*FORMER[first], *rest]


def _is_model(word: str) -> bool:
    """Return whether a word names a file, a folder, a shipped scene or a robot."""
    path = Path(word)
    return bool(path.suffix) or "/" in word or ":" in word or path.exists() or word in scene_names()
