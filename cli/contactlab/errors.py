"""One exception class for each cause of failure, with the exit code of the command line.

A message names the problem, its place, and the correct form.
"""

import difflib
import errno
import re
import traceback
from collections.abc import Collection, Generator, Iterable
from contextlib import contextmanager
from importlib.metadata import requires
from pathlib import Path


class ContactlabError(Exception):
    """A failure that the user can act on; printed as one clear message, without a traceback."""

    exit_code = 2

    @classmethod
    def unless_known(
        cls,
        name: str,
        known_names: Collection[str],
        message: str,
        otherwise: str = "",
        rest: str = "",
    ) -> None:
        """Raise it for a name that is not known, with the closest one that is, or something else.

        Both follow the message; the rest follows them.
        """
        if name not in known_names:
            raise cls(f"{message}{did_you_mean(name, known_names) or otherwise}{rest}")


class CommandLineError(ContactlabError):
    """The words of a command line are wrong."""


class SweepFileError(ContactlabError):
    """A sweep file or a sweep option has mistakes; the message lists all of them."""


class SceneError(ContactlabError):
    """A scene, its manifest or its model cannot be used as asked."""


class DriveFileError(SceneError):
    """A file of a drive cannot be used."""

    def __init__(self, message: str, file: Path) -> None:
        """Take the message, and the path of the file."""
        super().__init__(message)
        self.file = file


class AdvisoryError(ContactlabError):
    """An advisory has mistakes, or its witness cannot be run here."""


class PolicyError(ContactlabError):
    """A policy refers to something that the compared stores do not have."""


class EngineError(ContactlabError):
    """An engine, or a version of it, is not available or cannot run this."""


class CompilerError(ContactlabError):
    """There is no C compiler, or its result cannot be stored."""


class PluginError(ContactlabError):
    """A plug-in cannot be loaded, or adds a name that exists already."""


class ClusterError(ContactlabError):
    """A cluster cannot be reached, or one of its nodes does not meet the requirements."""


class OutputError(ContactlabError):
    """Results cannot be written to the given place."""


class StoreError(ContactlabError):
    """Stored evidence is missing, damaged or of another schema version."""

    exit_code = 3


class OtherSweepError(StoreError):
    """A place holds a store of another sweep, or of the same one by other code: `held` says so."""

    def __init__(self, content: str, remedy: str) -> None:
        super().__init__(f"{content}; {remedy}")
        self.held = content


class ExpectationError(ContactlabError):
    """Evidence was written, but it does not meet the expectations."""

    exit_code = 1


class RunFailedError(ContactlabError):
    """The sweep finished, but some runs crashed or timed out."""

    exit_code = 4


class StoppedError(ContactlabError):
    """A sweep was stopped early; its store can be resumed."""

    exit_code = 130  # as a shell reports a command that Ctrl-C ended


class FaultError(ContactlabError):
    """A fault of contactlab itself, which is reported; no input should cause one."""

    exit_code = 70  # EX_SOFTWARE of sysexits.h


class ModelWarning(UserWarning):
    """Warning of MuJoCo when it compiles a model."""


class UnheldWarning(ModelWarning):
    """Warning of parts that a drive which holds a model cannot hold."""


def check_digits(text: str) -> None:
    """Raise a ValueError for a number with other digits than 0 to 9, which Python would read."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"write a number with the digits 0 to 9, not {text!r}")


def suggestion(name: str, known_names: Iterable[str], alike: float = 0.6) -> str:
    """Return "did you mean 'x'?" for the closest known name, or an empty string.

    Names are close from a ratio of letters that they share.
    """
    close = difflib.get_close_matches(name, list(known_names), n=1, cutoff=alike)
    return f"did you mean '{close[0]}'?" if close else ""


def did_you_mean(name: str, known_names: Iterable[str]) -> str:
    """Return a suggestion to append to a message, behind a semicolon; or an empty string."""
    return f"; {hint}" if (hint := suggestion(name, known_names)) else ""


def explain_fatal(error: Exception) -> str:
    """Return the reason of a `mujoco.FatalError`, with a remedy if there is one."""
    if "memory" in str(error):
        return 'its contacts need more memory; reserve more by <size memory="1G"/>'
    return str(error).splitlines()[0]


def refuse_pipe(path: Path) -> None:
    """Raise an OSError if a path names a pipe or device, which would be waited for."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "it is not a regular file", str(path))


def no_file(path: Path, kind: str, suffixes: Collection[str] = ()) -> str:
    """Return a message on a missing file of a kind, with the files of its folder."""
    if path.is_dir():
        return f"{path} is a folder, no {kind}; name a file in it"
    if not path.parent.is_dir():
        return f"no {kind} {path}; there is no folder {path.parent}"
    suffixes = [suffix for suffix in suffixes if suffix]
    file_names = sorted(file.name for file in path.parent.iterdir() if file.is_file())
    names = [name for name in file_names if not suffixes or Path(name).suffix in suffixes]
    most_nearby = 3
    endings = f"{' or '.join(suffixes)} file" if suffixes else kind
    nearby_names = ", ".join(names[:most_nearby]) or f"no {endings}"
    # Files of one kind end alike, so that their stems tell which one is close.
    stems = {Path(name).stem: name for name in names}
    close = difflib.get_close_matches(path.stem, stems, n=1)
    near = f"; did you mean '{stems[close[0]]}'?" if close else ""
    return (
        f"no {kind} {path}{near or f'; the folder {path.parent.resolve().name} has {nearby_names}'}"
    )


# Of files whose frames lie between a caller and the code that it runs.
_BETWEEN = ("importlib", "contextlib", "foreign_code.py")


def in_one_line(error: BaseException, caller: str) -> str:
    """Return an error of the user's code in one line, after the line of that code that raised it.

    The caller is the `__file__` of the module that ran the code.
    """
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename != caller and not any(map(frame.filename.count, _BETWEEN))
    ]
    lines = [frame.lineno for frame in frames if frame.filename == frames[0].filename]
    where = f"line {lines[-1]} of {Path(frames[0].filename).name}: " if lines else ""
    return f"{where}{error_text(error)}"


def error_text(error: BaseException) -> str:
    """Return the type and the text of an error in one line; code may make its text unreadable."""
    try:
        text = " ".join(str(error).split())
    except BaseException as unreadable:  # noqa: BLE001 - code of a user
        text = f"its text cannot be read: {type(unreadable).__name__}"
    return type(error).__name__ + (f": {text}" if text else "")


_OF_EXTRA = re.compile(r"(?P<requirement>[^;]+);\s*extra\s*==\s*['\"](?P<extra>[\w-]+)['\"]")


def install_command(extra: str) -> str:
    """Return the command that installs the packages of an extra, from the package's metadata.

    It never names contactlab itself: on a package index, that name may be anybody's.
    """
    requirements = filter(None, map(_OF_EXTRA.fullmatch, requires("contactlab") or ()))
    needed = [f"'{each['requirement'].strip()}'" for each in requirements if each["extra"] == extra]
    return " ".join(["pip install", *needed])


@contextmanager
def optional(extra: str, purpose: str) -> Generator[None]:
    """Turn a missing import into an OutputError that says how to install an extra.

    The purpose names its use.
    """
    try:
        yield
    except ImportError as error:
        missing = error.name or str(error)
        raise OutputError(
            f"{purpose} needs {missing.partition('.')[0]}, which is not installed; "
            f"{install_command(extra)}"
        ) from error
