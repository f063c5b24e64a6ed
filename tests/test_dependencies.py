"""Every dependency of a module stands in an import statement, and none is mutual."""

import importlib.util
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest
from bench.dependencies import Graph, cycles, imports, module_files, named_imports, reachable
from bench.dependencies import watched_imports as watched

import contactlab
from contactlab.commands import CommandModule, load_command
from contactlab.registry import own_parts

PACKAGE = Path(contactlab.__file__).parent
# Packages whose modules declare entries of registries when they are imported.
DECLARING = ("measure", "engines", "studies.lint", "studies.check")


@cache
def graph() -> Graph:
    """Return the imports of all modules, which only the process that runs these tests reads."""
    return imports(PACKAGE)


def package(folder: Path, files: Mapping[str, str]) -> Path:
    """Write a package of some modules, and return its folder."""
    for name, text in {"__init__.py": "", "low.py": "", "high.py": "", **files}.items():
        file = folder / "contactlab" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return folder / "contactlab"


@pytest.mark.long
def test_no_module_is_imported_by_a_string() -> None:
    assert [str(place) for place in named_imports(PACKAGE)] == []


@pytest.mark.parametrize(
    "code",
    [
        "import importlib; importlib.import_module('contactlab.high')",
        "from importlib import import_module as load; load('contactlab.high')",
        "import importlib; load = getattr(importlib, 'import_module'); load(__package__ + '.high')",
        "from importlib import import_module; name = 'high'; import_module(f'contactlab.{name}')",
        "from importlib import import_module; import_module('contactlab.' + 'high')",
        "from importlib import import_module; import_module(f'{__name__}.high')",
        "from importlib import import_module; import_module('.high', 'contactlab')",
        "from importlib import import_module; names = []; modules = [*map(import_module, names)]",
        "__import__('contactlab', fromlist=['high'])",
        "from importlib.util import find_spec; find_spec('contactlab.high')",
        "from pkgutil import resolve_name; resolve_name('contactlab.high:run')",
        "from pkgutil import iter_modules; names = list(iter_modules(__path__))",
        "HOMES = {'run': 'contactlab.high'}",
        "HOMES = {'run': 'contactlab.high:run'}",
        "HOMES = {'run': 'contactlab.high.run'}",
        "import sys; high = sys.modules['contactlab.high']",
        "import sys; high = sys.modules.get('high')",
        "exec('from contactlab.high import run')",
        "command = ['python', '-c', 'import contactlab.high; contactlab.high.run()']",
        "command = ['python', '-m', 'contactlab.high']",
    ],
)
def test_each_way_to_import_by_a_string_is_found(tmp_path: Path, code: str) -> None:
    (found, *_) = named_imports(package(tmp_path, {"low.py": f"'''Low.'''\n\n{code}\n"}))
    assert (found.file, found.line) == ("contactlab/low.py", 3)


@pytest.mark.parametrize(
    "code",
    [
        "'''It is imported by `contactlab.high`.'''",
        "from importlib import import_module; import_module('mujoco')",
        "from importlib import import_module; import_module(f'mujoco.{__name__}')",
        "from importlib.metadata import version; version('contactlab')",
        "from importlib.metadata import entry_points; entry_points(group='contactlab.metrics')",
        "from contactlab.high import run",
    ],
)
def test_other_uses_of_a_name_are_none(tmp_path: Path, code: str) -> None:
    assert named_imports(package(tmp_path, {"low.py": code})) == []


@pytest.mark.long
def test_no_modules_depend_on_each_other() -> None:
    assert cycles(graph()) == []


@pytest.mark.long
def test_no_module_imports_the_functions_of_the_whole_package() -> None:
    """They import commands, which the layers do not see."""
    assert [name for name, imported in graph().items() if "contactlab" in imported] == []


def test_a_cycle_through_a_function_is_found(tmp_path: Path) -> None:
    files = {
        "low.py": "def run():\n    from contactlab.inner import middle\n",
        "inner/__init__.py": "",
        "inner/middle.py": "import contactlab.high",
        "high.py": "from contactlab.low import run",
        "other.py": "import contactlab.high",
    }
    named = ["contactlab.high", "contactlab.inner.middle", "contactlab.low"]
    assert cycles(imports(package(tmp_path, files))) == [named]


@pytest.mark.parametrize("name", DECLARING)
def test_a_package_imports_each_module_that_declares_entries(name: str) -> None:
    """One that is forgotten would have its entries only where something else imports it."""
    first = f"contactlab.{name}"
    reached = reachable(graph(), first)
    words = ("check", "engine", "label", "metric", "oracle", "rule")
    declaring = [
        module
        for module, file in module_files(PACKAGE).items()
        if module.startswith(f"{first}.")
        and any(f"\n@{word}" in file.read_text(encoding="utf-8") for word in words)
    ]
    assert declaring
    assert set(declaring) <= reached


def test_every_module_of_commands_is_registered() -> None:
    files = {name.rpartition(".")[2] for name in graph() if name.startswith("contactlab.commands.")}
    assert [*own_parts("command module")] == sorted(files)


@pytest.mark.long
@pytest.mark.parametrize("name", own_parts("command module"))
def test_a_command_is_loaded_by_its_name(name: CommandModule) -> None:
    assert load_command(name).__name__ == f"contactlab.commands.{name}"


EMPTY = """
from contactlab.plugins import find_extensions
try:
    find_extensions("viewer")
except RuntimeError as error:
    print(error)
"""


def printed(code: str, folder: Path) -> str:
    """Return what code prints in a process of its own."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


def test_an_empty_registry_says_how_it_is_filled(tmp_path: Path) -> None:
    assert "import `contactlab.plugin` first" in printed(EMPTY, tmp_path)


@pytest.mark.parametrize(
    "entry",
    [
        "import contactlab; contactlab.sweep",
        "import contactlab.plugin",
        "import contactlab.testing.plugin",
        pytest.param("import contactlab.gymnasium", marks=pytest.mark.long),
    ],
)
def test_every_entry_registers_the_parts(entry: str, tmp_path: Path) -> None:
    if "gymnasium" in entry and importlib.util.find_spec("gymnasium") is None:
        pytest.skip("gymnasium is not installed")
    reading = "from contactlab.plugins import find_extensions\nprint(*find_extensions('viewer'))"
    code = f"{entry}\n{reading}"
    assert printed(code, tmp_path).split() == ["gif", "mcap", "mp4", "png", "rrd", "svg", "window"]


def test_a_command_imports_nothing_by_a_string(tmp_path: Path) -> None:
    assert watched(("list", "scenes"), tmp_path) == []


@pytest.mark.long
def test_an_import_by_a_string_is_seen_as_it_runs(tmp_path: Path) -> None:
    (tmp_path / "named.py").write_text(
        "from importlib import import_module\n"
        "from contactlab.plugin import metric\n"
        "import_module('contactlab.page.map_cells')\n"
        "@metric(unit='1')\n"
        "def nothing(context):\n"
        "    '''Nothing.'''\n"
    )
    found = watched(("explain", "nothing", "--plugin", "named.py"), tmp_path)
    assert found[-1] == f"contactlab.page.map_cells, by {tmp_path / 'named.py'}:3"
    assert {place.partition(", by ")[2] for place in found} == {f"{tmp_path / 'named.py'}:3"}
