"""The index of the shipped advisories: from each file's SHA-256 to its parsed content.

YAML takes longer to read than a model takes to lint. Run, after a shipped advisory was changed:
python -m tests.advisories.advisory_index
"""

import json
from hashlib import sha256
from typing import Any

from contactlab import resources
from contactlab.advisories.advisory_files import parse_advisory


def advisory_index() -> dict[str, Any]:
    """Return the index, made from the files."""
    return {
        sha256(file.read_bytes()).hexdigest(): parse_advisory(file).model_dump(
            mode="json", exclude_defaults=True
        )
        for file in sorted(resources.ADVISORIES.glob("*.yaml"))
    }


def main() -> None:
    """Write the index."""
    rows = [f"{json.dumps(key)}: {json.dumps(row)}" for key, row in advisory_index().items()]
    text = "{\n" + ",\n".join(rows) + "\n}\n"
    (resources.ADVISORIES / "index.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
