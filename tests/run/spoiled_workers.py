"""Faults of workers: code that each of them runs before its first job."""

from pathlib import Path
from textwrap import dedent

# Python runs this before anything else; forked are workers, and what they are forked from.
_AT_FORK = "import os\nos.register_at_fork(after_in_child=lambda: __import__('injected_faults'))\n"


def spoil_workers(folder: Path, code: str, *, here: bool = False) -> Path:
    """Have workers of a command that looks into a folder first run some code; return the folder.

    Or the command itself, where it has no workers.
    """
    folder.mkdir(exist_ok=True)
    at_once = "import contactlab.startup, injected_faults\n"
    (folder / "sitecustomize.py").write_text(at_once if here else _AT_FORK)
    (folder / "injected_faults.py").write_text(dedent(code))
    return folder
