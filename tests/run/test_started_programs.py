"""Which programs the package starts, each of them in a way that reads no code of a folder."""

import ast
import re
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

import contactlab

pytestmark = pytest.mark.long

PACKAGE = Path(contactlab.__file__).parent
STARTS = {
    *("run", "Popen", "call", "check_call", "check_output", "getoutput", "getstatusoutput"),
    *("system", "popen", "execv", "execve", "execvp", "execvpe", "posix_spawn", "posix_spawnp"),
    *("create_subprocess_exec", "create_subprocess_shell"),
}
MODULES = {"subprocess", "os", "asyncio", "pty"}
NEEDED = re.compile(rf"\b({'|'.join(MODULES)})\b|sys\.executable|\"git\"")
# Who starts a program, and why the current folder has no say in what that program does.
ALLOWED = {
    "engines/adapted_engine.py": "Python with -P",
    "native.py": "the compiler, which reads the files it is given; ziglang by Python with -P",
    "run/mujoco_environment.py": "uv and pip in a folder of their own; Python with PYTHONSAFEPATH",
    "run/ray/connection.py": "Python with -P",
    "run/stored_runs.py": "Python with -P",
    "studies/advisories/release_process.py": "Python with -P, and a release in a folder of its own",
    "studies/lock/versions.py": "Python with -P; pytest, whose tests are code of the folder",
}


@cache
def _sources() -> dict[str, ast.AST]:
    """Return the modules that could start a program, by their place in the package."""
    texts = {
        path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    return {name: ast.parse(text) for name, text in texts.items() if NEEDED.search(text)}


def _starts_a_program(tree: ast.AST) -> bool:
    return any(
        isinstance(node, ast.Attribute)
        and node.attr in STARTS
        and isinstance(node.value, ast.Name)
        and node.value.id in MODULES
        for node in ast.walk(tree)
    )


def test_only_known_modules_start_programs() -> None:
    found = {name for name, tree in _sources().items() if _starts_a_program(tree)}
    assert found == set(ALLOWED)


def test_no_module_hides_what_it_starts() -> None:
    """A name that is imported out of these modules would not be seen as a call of theirs."""
    for name, tree in _sources().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module in MODULES:
                assert not STARTS & {each.name for each in node.names}, name


def test_python_is_started_without_the_current_folder() -> None:
    """`python -m` looks for modules in the current folder first, and so for `random.py`."""
    for name, tree in _sources().items():
        for node in ast.walk(tree):
            if not isinstance(node, ast.List):
                continue
            words = [ast.unparse(each) for each in node.elts]
            for word, following in pairwise(words):
                if word == "sys.executable" and following.startswith("'"):
                    assert following == "'-P'", f"{name}: {words}"


def test_git_is_never_started() -> None:
    """It runs programs that a repository's configuration names."""
    for name, tree in _sources().items():
        for node in ast.walk(tree):
            assert not (isinstance(node, ast.Constant) and node.value == "git"), name
