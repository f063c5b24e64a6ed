"""Rates of the style guide, measured over the package: per 1,000 words and per function."""

import ast
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from tests.prose.rules import check_text, split_name
from tests.prose.texts import FileContent, read_file

_FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
_WORD = re.compile(r"[A-Za-z][A-Za-z'-]*")


def measure_rates(root: Path) -> dict[str, float]:
    """Return each measured quantity, by what the style guide calls it."""
    contents = [read_file(path) for path in sorted((root / "cli").rglob("*.py"))]
    trees = [content.tree for content in contents if content.tree is not None]
    functions = [node for tree in trees for node in ast.walk(tree) if isinstance(node, _FUNCTION)]
    used_once = [count_used_once(tree) for tree in trees]
    documents = [root / "README.md", *sorted((root / "docs").rglob("*.md"))]
    return {
        **_rates_of_words(contents),
        "words per function name": _mean(
            len(split_name(node.name)) for node in functions if not node.name.startswith("__")
        ),
        "mean lines per function": _mean(map(_length, functions)),
        "functions": len(functions),
        "private functions used once": sum(everywhere for everywhere, _ in used_once),
        "  of these called outside comprehensions, at module level": sum(
            plainly for _, plainly in used_once
        ),
        "numeric constants at module level": sum(map(count_numeric_constants, trees)),
        "words of README.md and docs": count_words(documents),
        "words of CHANGELOG.md": count_words([root / "CHANGELOG.md"]),
    }


def count_words(paths: Iterable[Path]) -> int:
    """Return the words of files as `wc -w` counts them."""
    return sum(len(path.read_text(encoding="utf-8").split()) for path in paths)


def count_numeric_constants(tree: ast.Module) -> int:
    """Return the number of assignments at module level that have a number in their value."""
    return sum(
        isinstance(node, ast.Assign | ast.AnnAssign)
        and node.value is not None
        and any(map(_is_number, ast.walk(node.value)))
        for node in tree.body
    )


def count_used_once(tree: ast.Module) -> tuple[int, int]:
    """Return how many private functions and methods their module uses once.

    The second count has functions at module level whose only use is a call outside a comprehension
    or lambda: their body could stand where they are called.
    """
    used: Counter[str] = Counter()
    called: Counter[str] = Counter()
    repeated: Counter[str] = Counter()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name | ast.Attribute):
            used[_last_name(node)] += 1
        elif isinstance(node, ast.Call):
            called[_last_name(node.func)] += 1
        elif isinstance(
            node, ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp | ast.Lambda
        ):
            calls = (each for each in ast.walk(node) if isinstance(each, ast.Call))
            repeated.update(_last_name(each.func) for each in calls)
    top = _private_names(tree)
    methods = [
        name
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for name in _private_names(node)
    ]
    plainly = [n for n in top if used[n] == called[n] == 1 and not repeated[n]]
    return sum(used[name] == 1 for name in top + methods), len(plainly)


def _rates_of_words(contents: Iterable[FileContent]) -> dict[str, float]:
    found: Counter[str] = Counter()
    words = 0
    for content in contents:
        for text in content.texts:
            words += len(_WORD.findall(text.flat))
            found.update(finding.rule for finding in check_text(text))
    rates: dict[str, float] = {"words of prose": words}
    names = {
        "what": '"what" as a noun',
        "which": "of which, by which, whose",
        "odd-word": "odd words",
    }
    for rule, name in {**names, "opening": "fronted openings"}.items():
        rates[f"{name}, per 1,000 words"] = 1000 * found[rule] / max(1, words)
    return rates


def _private_names(node: ast.Module | ast.ClassDef) -> list[str]:
    names = [each.name for each in node.body if isinstance(each, _FUNCTION)]
    return [name for name in names if name.startswith("_") and not name.startswith("__")]


def _last_name(node: ast.expr) -> str:
    if isinstance(node, ast.Attribute):
        return node.attr
    return node.id if isinstance(node, ast.Name) else ""


def _mean(values: Iterable[int]) -> float:
    numbers = list(values)
    return sum(numbers) / max(1, len(numbers))


def _length(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def _is_number(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant)
        and isinstance(node.value, int | float)
        and not isinstance(node.value, bool)
    )
