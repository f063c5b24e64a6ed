"""Count the files, functions and changes of file that one traced run passes through.

A newcomer who follows a run from the command to the table reads these files. Run with
`python -m bench.traced_files`; `--list` names them.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any

import contactlab

PACKAGE = str(Path(contactlab.__file__).parent)


class Journey:
    """What is called while it is installed as the profile function."""

    def __init__(self) -> None:
        self.calls: Counter[str] = Counter()
        self.functions: set[tuple[str, str]] = set()
        self.changes = 0
        self._last = ""
        self._importing = 0

    def __call__(self, frame: FrameType, event: str, _arg: object) -> None:
        """Count a call of a function of the package, but for what imports call."""
        code = frame.f_code
        if code.co_name == "<module>":
            self._importing += {"call": 1, "return": -1}.get(event, 0)
        file = code.co_filename
        if event != "call" or self._importing or not file.startswith(PACKAGE):
            return
        self.calls[file] += 1
        self.functions.add((file, code.co_qualname))
        self.changes += file != self._last
        self._last = file


def journey() -> Journey:
    """Sweep one run with its trace in this process, from the command line's entry on."""
    from contactlab.commands.main import main  # noqa: PLC0415 - what it imports is not the journey

    seen = Journey()
    with tempfile.TemporaryDirectory() as folder:
        store = str(Path(folder) / "store")
        options: list[Any] = ["--limit", "1", "--workers", "0", "-o", store]
        sys.argv = ["contactlab", "sweep", "bounce", *options]
        sys.setprofile(seen)
        try:
            main()
        except SystemExit as ended:
            if ended.code:
                raise
        finally:
            sys.setprofile(None)
    return seen


def run() -> None:
    """Print the counts."""
    listed = "--list" in sys.argv
    seen = journey()
    if listed:
        for file in sorted(seen.calls):
            print(f"{seen.calls[file]:7}  {Path(file).relative_to(PACKAGE)}", file=sys.stderr)
    print(f"files      {len(seen.calls)}", file=sys.stderr)
    print(f"functions  {len(seen.functions)}", file=sys.stderr)
    print(f"changes    {seen.changes}", file=sys.stderr)


if __name__ == "__main__":
    run()
