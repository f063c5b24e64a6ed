"""Replays witnesses, and dies at the second one."""

import os
import sys

from contactlab.studies.advisories import witness_process

if __name__ == "__main__":
    files = sys.argv[1:]
    dying = [place for place, file in enumerate(files) if "0002" in file]
    sys.argv[1:] = files[: dying[0]] if dying else files
    witness_process.main()
    if dying:
        witness_process.print_line(file=files[dying[0]])
        os._exit(11)
