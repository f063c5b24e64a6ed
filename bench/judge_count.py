"""Count labels, thresholds and further constants of the judge: python -m bench.judge_count [ROOT].

Labels and thresholds are the entries that `@label` and `Threshold(...)` declare; constants are all
other numbers that a name in capitals holds, in measure/, engines/self_checks.py and passages.py.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

_FILES = "measure/*.py", "engines/self_checks.py", "engines/passages.py"


def _named(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Yield names of constants with the numbers that they hold."""
    for node in tree.body:
        if not isinstance(node, ast.Assign):
            continue
        (target, value) = node.targets[0], node.value
        targets = target.elts if isinstance(target, ast.Tuple) else [target]
        values = value.elts if isinstance(value, ast.Tuple) else [value]
        if len(targets) != len(values):
            targets, values = targets[:1], [value]
        for name, held in zip(targets, values, strict=True):
            if isinstance(name, ast.Name) and name.id.isupper():
                yield name.id, held


def _calls(tree: ast.Module, name: str) -> int:
    return sum(
        isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name
        for node in ast.walk(tree)
    )


def _is_number(value: ast.expr) -> bool:
    """Return whether an expression is made of numbers alone."""
    parts = [node for node in ast.walk(value) if isinstance(node, ast.Constant)]
    free = any(isinstance(node, (ast.Call, ast.Name)) for node in ast.walk(value))
    return bool(parts) and not free and all(isinstance(part.value, int | float) for part in parts)


def constants(root: Path) -> Iterator[tuple[str, str]]:
    """Yield the file and the name of each constant of the judge of a checkout."""
    packages = root / "cli" / "contactlab"
    for file in sorted(file for pattern in _FILES for file in packages.glob(pattern)):
        for name, value in _named(ast.parse(file.read_text(encoding="utf-8"))):
            if _is_number(value):
                yield file.stem, name


def count(root: Path) -> dict[str, int]:
    """Return how many labels, thresholds, constants and lines the judge of a checkout has."""
    found: dict[str, int] = dict.fromkeys(("labels", "thresholds", "constants", "lines"), 0)
    packages = root / "cli" / "contactlab"
    for file in sorted(file for pattern in _FILES for file in packages.glob(pattern)):
        text = file.read_text(encoding="utf-8")
        tree = ast.parse(text)
        found["labels"] += _calls(tree, "label") + _calls(tree, "Label")
        found["thresholds"] += _calls(tree, "Threshold")
        found["lines"] += len(text.splitlines())
    found["constants"] = len([*constants(root)])
    return found


if __name__ == "__main__":
    checkout = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    print("\n".join(f"{name}: {number}" for name, number in count(checkout).items()))
