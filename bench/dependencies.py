"""How the modules of a package depend on each other: by import statements, by strings, in cycles.

`imports` and `cycles` read the source, with the imports inside functions. `named_imports` finds
dependencies that an import statement does not show, since a module is named by a string.
`watched_imports` finds them in a process that runs.
"""

import ast
import dis
import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

Graph = Mapping[str, frozenset[str]]

# Functions that import the module whose name they are given.
_IMPORTERS = frozenset({"__import__", "import_module", "resolve_name", "run_module", "run_path"})
# Functions that look a module up by its name.
_FINDERS = frozenset({"find_loader", "find_spec", "get_loader", "iter_modules", "walk_packages"})
# Names in files that contactlab writes, which are also names of modules.
_NAMES_OF_DATA = frozenset({"contactlab.run"})
_LOADED_MODULES = ast.dump(ast.parse("sys.modules", mode="eval").body)
_PARTS_OF_TEXT = ast.JoinedStr, ast.FormattedValue, ast.BinOp
_HOLE = "\0"  # stands for the part of a text that is known only when it runs


@dataclass(frozen=True)
class NamedImport:
    """A place where a module of the package is named by a string."""

    file: str
    line: int
    code: str

    def __str__(self) -> str:
        """Return place and code."""
        return f"{self.file}:{self.line}: {self.code}"


def module_files(package: Path) -> dict[str, Path]:
    """Return the files of a package by the names of their modules."""
    return {_module_name(package, file): file for file in sorted(package.rglob("*.py"))}


def _module_name(package: Path, file: Path) -> str:
    parts = file.relative_to(package.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


@cache
def _parents_of_nodes(file: Path) -> Mapping[ast.AST, ast.AST]:
    # Of all nodes but the module, breadth first. To walk the package takes most of the time.
    parents = dict[ast.AST, ast.AST]()
    waiting = deque[ast.AST]([ast.parse(file.read_text(encoding="utf-8"))])
    while waiting:
        node = waiting.popleft()
        for child in ast.iter_child_nodes(node):
            parents[child] = node
            waiting.append(child)
    return parents


def imports(package: Path) -> Graph:
    """Return the modules of a package that each of them imports, inside functions too."""
    files = module_files(package)
    return {
        name: frozenset(_imported(_parents_of_nodes(file), set(files)) - {name})
        for name, file in files.items()
    }


def _imported(nodes: Iterable[ast.AST], modules: set[str]) -> set[str]:
    found = set[str]()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in modules else node.module)
    return found & modules


def reachable(graph: Graph, start: str) -> set[str]:
    """Return the modules that a module imports, directly and through others."""
    found, waiting = set[str](), [start]
    while waiting:
        for name in graph[waiting.pop()] - found:
            found.add(name)
            waiting.append(name)
    return found


def cycles(graph: Graph) -> list[list[str]]:
    """Return each largest set of modules of which every one depends on every other, sorted."""
    reached = {name: reachable(graph, name) for name in graph}
    groups = {
        tuple(sorted(other for other in reached[name] if name in reached[other])) for name in graph
    }
    return [list(group) for group in sorted(groups) if group]


def named_imports(package: Path) -> list[NamedImport]:
    """Return the places of a package where a string names one of its modules."""
    modules = set(module_files(package))
    return [
        NamedImport(file.relative_to(package.parent).as_posix(), node.lineno, ast.unparse(node))
        for file in module_files(package).values()
        for node in _named(_parents_of_nodes(file), package.name, modules)
    ]


def _named(
    parents: Mapping[ast.AST, ast.AST], root: str, modules: set[str]
) -> Iterator[ast.expr | ast.alias]:
    """Yield the places of a module that name, import or look up a module by a string."""
    for node, parent in parents.items():
        if isinstance(node, (ast.Name, ast.Attribute)):
            if _imports_or_finds(node, parent, root) or _reads_loaded_modules(node, parent):
                yield node
        elif isinstance(node, (ast.Constant, ast.JoinedStr, ast.BinOp)):
            text = None if isinstance(parent, (ast.Expr, *_PARTS_OF_TEXT)) else _text(node)
            if text is not None and (text in _IMPORTERS or _names_module(text, root, modules)):
                yield node
        elif isinstance(node, ast.alias) and node.name in _IMPORTERS and node.asname:
            yield node


def _imports_or_finds(node: ast.Name | ast.Attribute, call: ast.AST, root: str) -> bool:
    """Return whether an expression is a function that may import or look up own modules."""
    name = node.id if isinstance(node, ast.Name) else node.attr
    if name not in _IMPORTERS | _FINDERS:
        return False
    if not isinstance(call, ast.Call) or call.func is not node or not call.args:
        return True  # handed on, as to map()
    text = _text(call.args[0])
    package = (text or "").split(".")[0]
    if text is None or _HOLE in package:
        # Packages of plug-ins are looked up, but never imported, by names that others give.
        return name in _IMPORTERS or name in {"iter_modules", "walk_packages"}
    return package in {root, ""}  # "" of a name that begins with a dot


def _reads_loaded_modules(node: ast.Name | ast.Attribute, place: ast.AST) -> bool:
    """Return whether an expression is sys.modules, of which an entry is read."""
    if getattr(node, "attr", "") != "modules" or ast.dump(node) != _LOADED_MODULES:
        return False
    if isinstance(place, ast.Subscript):
        return isinstance(place.ctx, ast.Load)
    return isinstance(place, ast.Attribute) and place.attr in {"get", "items", "pop", "values"}


def _names_module(text: str, root: str, modules: set[str]) -> bool:
    """Return whether a text is the name of a module, or code that imports one."""
    name = text.partition(":")[0]
    if name in _NAMES_OF_DATA:
        return False
    if name in modules - {root} or name.rpartition(".")[0] in modules - {root}:
        return True
    words = text.replace(",", " ").replace(";", " ; ").split()
    return any(
        one in {"from", "import"} and (other == root or other.startswith(f"{root}."))
        for one, other in pairwise(words)
    )


def _text(node: ast.AST) -> str | None:
    """Return the text of a string as far as it is written there; None of what is no string."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(_text(part) or _HOLE for part in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = _text(node.left), _text(node.right)
        return None if left is None and right is None else (left or _HOLE) + (right or _HOLE)
    return None


def watched_imports(words: Sequence[str], folder: Path) -> list[str]:
    """Run a command in a folder; return the modules that its process imports by a string.

    Each is followed by the place that does.
    """
    with tempfile.NamedTemporaryFile(suffix=".json") as found:
        done = subprocess.run(
            [sys.executable, "-P", __file__, found.name, *words],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode not in (0, 1):
            raise RuntimeError(f"contactlab {' '.join(words)}: {done.stderr.strip()}")
        return json.loads(Path(found.name).read_text(encoding="utf-8"))


class _Watch:
    """Notes which modules of contactlab are imported by anything but an import statement."""

    def __init__(self) -> None:
        self.found = list[str]()

    def find_spec(self, name: str, _path: object = None, _target: object = None) -> None:
        """Look at who imports a module; it is found by others."""
        if not name.startswith("contactlab."):
            return
        frame = sys._getframe(1)  # pyright: ignore[reportPrivateUsage]
        machinery = "<frozen importlib", importlib.__file__
        while frame.f_back and frame.f_code.co_filename.startswith(machinery):
            frame = frame.f_back
        if frame.f_code.co_code[frame.f_lasti] != dis.opmap["IMPORT_NAME"]:
            self.found.append(f"{name}, by {frame.f_code.co_filename}:{frame.f_lineno}")


def _main() -> None:
    """Run the command line with the arguments after the first, the file for what is found."""
    file, watch, own = Path(sys.argv[1]), _Watch(), os.getpid()
    sys.argv[:2] = ["contactlab"]
    sys.meta_path.insert(0, watch)  # pyright: ignore[reportArgumentType]
    from contactlab.__main__ import main  # noqa: PLC0415 - it is watched

    try:
        main()
    finally:
        if os.getpid() == own:
            file.write_text(json.dumps(watch.found), encoding="utf-8")


if __name__ == "__main__":
    _main()
