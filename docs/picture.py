"""Draw docs/bounce.svg: what a terminal shows of `contactlab sweep bounce`.

Run by `make picture`.
"""

import io
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.text import Text

_COMMAND = ["contactlab", "sweep", "bounce"]
_WIDTH = 118
# The picture stands by itself: fonts come from whoever looks at it.
_FOREIGN = re.compile(r"@font-face \{.*?\}\s*|<!-- .*? -->\s*", re.DOTALL)


def main() -> None:
    """Run the sweep and write its output as a picture."""
    environment = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": str(_WIDTH)}
    tool = Path(sys.executable).with_name(_COMMAND[0])
    with TemporaryDirectory() as folder:
        done = subprocess.run(  # noqa: S603 - our own command
            [tool, *_COMMAND[1:]], cwd=folder, env=environment, capture_output=True, check=True
        )
    console = Console(record=True, width=_WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(f"$ {' '.join(_COMMAND)}")
    console.print(Text.from_ansi(done.stdout.decode()))
    picture = console.export_svg(title="contactlab", unique_id="bounce")
    Path("docs/bounce.svg").write_text(_FOREIGN.sub("", picture), encoding="utf-8")


if __name__ == "__main__":
    main()
