"""The index of the shipped sweeps: from each file's SHA-256 to its row in `contactlab list sweeps`.

Run, after a shipped sweep was changed: python -m tests.commands.sweep_index
"""

import json
from hashlib import sha256

from contactlab import resources
from contactlab.commands.list import sweep_row


def sweep_index() -> dict[str, list[object]]:
    """Return the index, made from the files."""
    files = map(resources.sweep_file, resources.sweep_names())
    return {sha256(path.read_bytes()).hexdigest(): list(sweep_row(path)) for path in files}


def main() -> None:
    """Write the index."""
    rows = [f"{json.dumps(key)}: {json.dumps(row)}" for key, row in sweep_index().items()]
    text = "{\n" + ",\n".join(rows) + "\n}\n"
    (resources.SWEEPS / "index.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
