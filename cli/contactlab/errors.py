"""One class a cause of failure, each with the exit code that the command line ends in.

A message says what is wrong, where, and what to write instead.
"""

import difflib
from collections.abc import Generator, Iterable
from contextlib import contextmanager


class ContactlabError(Exception):
    """A failure that the user can act on; printed as one clear message, without a traceback."""

    exit_code = 2


class SweepFileError(ContactlabError):
    """A sweep file or a sweep option holds mistakes; all of them are in the message."""


class SceneError(ContactlabError):
    """A scene, its manifest or its model cannot be used as asked."""


class PolicyError(ContactlabError):
    """A policy asks for what the compared stores do not have."""


class EngineError(ContactlabError):
    """Another version of the engine cannot be had, or cannot run this."""


class PluginError(ContactlabError):
    """A plug-in cannot be loaded, or adds what is there already."""


class ClusterError(ContactlabError):
    """A cluster cannot be reached, or a node of it does not fit."""


class OutputError(ContactlabError):
    """Results cannot be written where they were asked for."""


class StoreError(ContactlabError):
    """Stored evidence is missing, damaged or of another schema version."""

    exit_code = 3


class ExpectationError(ContactlabError):
    """Evidence was written, but it is not what was expected of it."""

    exit_code = 1


class RunFailedError(ContactlabError):
    """The sweep went through, but some runs crashed or ran out of time."""

    exit_code = 4


class StoppedError(ContactlabError):
    """A sweep ended early because it was told to; its store is resumable."""

    # As a shell reports a command that Ctrl-C ended.
    exit_code = 130


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return "did you mean 'x'?" for the closest known name, or an empty string."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean '{close[0]}'?" if close else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a suggestion to append to a message, behind a semicolon; or an empty string."""
    return f"; {found}" if (found := suggestion(name, known)) else ""


@contextmanager
def optional(extra: str, purpose: str) -> Generator[None]:
    """Say how to get what an import within lacks.

    Args:
        extra: the optional part of this package that brings it.
        purpose: what it is needed for.

    Raises:
        OutputError: something is not installed.
    """
    try:
        yield
    except ImportError as error:
        missing = error.name or str(error)
        raise OutputError(
            f"{purpose} needs {missing.partition('.')[0]}, which is not installed; "
            f"pip install 'contactlab[{extra}]'"
        ) from error
