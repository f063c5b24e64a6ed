"""Replays witnesses in a process of its own, under the MuJoCo that it imports.

It prints a line of JSON for each file, before and after its replay, so that its parent knows which
witness ended the process.
"""

import json
import math
import sys
from pathlib import Path

from contactlab.advisories.advisory_files import read_advisory
from contactlab.advisories.witness_runs import replay_witness
from contactlab.errors import AdvisoryError


def main() -> None:
    """Replay the witnesses of the files that the command line names."""
    for file in sys.argv[1:]:
        print_line(file=file)
        try:
            run = replay_witness(read_advisory(Path(file)))
        except AdvisoryError as error:
            print_line(file=file, reason=str(error))
        else:
            result = run.measured if math.isfinite(run.measured) else None
            print_line(file=file, measured=result, meets=not run.obstacle, reason=run.obstacle)


def print_line(**values: object) -> None:
    """Print values as a line of JSON, at once."""
    print(json.dumps(values), flush=True)  # noqa: T201 - read by the parent


if __name__ == "__main__":
    main()
