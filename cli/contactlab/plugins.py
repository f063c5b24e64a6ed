"""Plug-ins: installed packages and files with metrics, labels, oracles, checks and engines.

A plug-in adds entries to registries when it is imported, most simply by the decorators of
`contactlab.plugin`. An installed package names its
modules, or single entries, in the entry-point groups of `GROUPS`.

Plug-ins are loaded because the user installs them or names a file, never because a store or a
scene names one.
"""

import hashlib
import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import Distribution, EntryPoint, distributions, entry_points
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from types import ModuleType

from contactlab.errors import PluginError, in_one_line, no_file, refuse_pipe
from contactlab.foreign_code import ends_command, limited_code
from contactlab.registry import REGISTRIES, NamedEntry, Part, own_parts, transaction

GROUPS = {f"contactlab.{kind}s": kind for kind in ("metric", "label", "oracle", "check", "engine")}
"""Entry-point groups, with the kind of entry that each adds."""


def find_extensions(kind: str) -> dict[str, Part | EntryPoint]:
    """Return the extensions of a kind by name: `command`, `schema`, `viewer`, ...

    These are contactlab's own parts and those of installed packages. They are loaded on request,
    and do not belong to the evidence.
    """
    installed = {entry.name: entry for entry in entry_points(group=f"contactlab.{kind}s")}
    return dict(sorted({**own_parts(kind), **installed}.items()))


@dataclass(frozen=True)
class Plugin:
    """A plug-in that is loaded in this process: a file, or an installed distribution.

    Its version is the distribution's, or the file's `__version__`; empty without one. The
    hash is that of the file, or of all files of the packages that the entry points name.
    """

    name: str
    version: str
    sha256: str
    file: Path | None = None

    def __str__(self) -> str:
        """Return name, version and the start of the hash."""
        return f"{self.name} {self.version or '(no version)'}, sha256 {self.sha256[:12]}"


_loaded: dict[str, Plugin] = {}


def loaded_plugins() -> tuple[Plugin, ...]:
    """Return the plug-ins that are loaded in this process, in the order of loading."""
    return tuple(_loaded.values())


def load_plugins(files: Sequence[Path] = ()) -> tuple[Plugin, ...]:
    """Load installed plug-ins, then files, once each; return all that are loaded now.

    A PluginError says that one cannot be loaded; nothing of it is left.
    """
    for distribution in sorted(_find_distributions(), key=lambda distributed: distributed.name):
        _load_distribution(distribution)
    for file in files:
        _load_file(file)
    return loaded_plugins()


def require_plugins(plugins: Iterable[Plugin]) -> None:
    """Load another process's plug-ins; raise PluginError for one that is not the same here."""
    for plugin in plugins:
        here = _load_file(plugin.file) if plugin.file else _load_installed(plugin.name)
        if here.sha256 != plugin.sha256:
            raise PluginError(f"this sweep began with plug-in {plugin}, but here is {here}")


def _load_installed(name: str) -> Plugin:
    plugin_distribution = next(
        (distribution for distribution in _find_distributions() if distribution.name == name), None
    )
    if plugin_distribution is None:
        raise PluginError(f"plug-in {name} is not installed here; install it on every node")
    return _load_distribution(plugin_distribution)


def _find_distributions() -> list[Distribution]:
    return [distribution for distribution in distributions() if _entry_points(distribution)]


def _entry_points(distribution: Distribution) -> list[EntryPoint]:
    return sorted(
        entry_point for entry_point in distribution.entry_points if entry_point.group in GROUPS
    )


def hash_of_packages(names: Iterable[str], *folders: Path) -> str:
    """Return a SHA-256 of all files of packages or modules, and of further folders of code."""
    digest = hashlib.sha256()
    for label, path in chain(*map(_package_files, sorted(names)), *map(_files_in, folders)):
        data = path.read_bytes()
        digest.update(f"{label}\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


def _package_files(package: str) -> list[tuple[str, Path]]:
    """Return the files of a top-level package or module, by name; nothing if it is missing."""
    spec = find_spec(package)
    if spec is None:
        return []
    if not spec.submodule_search_locations:
        return [(package, Path(spec.origin))] if spec.origin else []
    return sorted(chain(*map(_files_in, map(Path, spec.submodule_search_locations))))


def _files_in(folder: Path) -> list[tuple[str, Path]]:
    return sorted(
        (path.relative_to(folder).as_posix(), path)
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    )


def _load_distribution(distribution: Distribution) -> Plugin:
    names = {entry.module.partition(".")[0] for entry in _entry_points(distribution)}
    plugin = Plugin(distribution.name, distribution.version, hash_of_packages(names))
    if plugin.name in _loaded:
        return _require_same(plugin)
    with _guard_loading(plugin.name):
        for entry in _entry_points(distribution):
            entry_object = entry.load()
            registry = REGISTRIES[GROUPS[entry.group]]
            if isinstance(entry_object, type):
                if not any(type(registered) is entry_object for registered in registry.values()):
                    registry.add(entry_object())
            elif isinstance(entry_object, NamedEntry) and not isinstance(entry_object, ModuleType):
                registry.add(entry_object)
    _loaded[plugin.name] = plugin
    return plugin


def _load_file(file: Path) -> Plugin:
    path = file.expanduser().absolute()
    try:
        refuse_pipe(path)
        source = path.read_bytes()
    except OSError as error:
        raise PluginError(no_file(file, "plug-in", {".py"})) from error
    sha256 = hashlib.sha256(source).hexdigest()
    if path.stem in _loaded:
        return _require_same(Plugin(path.stem, _loaded[path.stem].version, sha256, path))
    module = ModuleType(f"contactlab_plugin_{path.stem}")
    module.__file__ = str(path)
    with _guard_loading(str(file)):
        before = _count_entries()
        # The hashed source is run. Classes of the module can be pickled once it is listed.
        sys.modules[module.__name__] = module
        exec(compile(source, path, "exec"), module.__dict__)  # noqa: S102 - the user names it
        if _count_entries() == before:
            raise PluginError("it adds no metric, label, oracle, check or engine")
    version = str(getattr(module, "__version__", ""))
    return _loaded.setdefault(path.stem, Plugin(path.stem, version, sha256, path))


def _require_same(plugin: Plugin) -> Plugin:
    loaded_plugin = _loaded[plugin.name]
    if loaded_plugin.sha256 != plugin.sha256:
        raise PluginError(
            f"another plug-in named {plugin.name} is loaded already, or it changed since; "
            "rename one, or start Python again"
        )
    return loaded_plugin


@contextmanager
def _guard_loading(name: str) -> Generator[None]:
    """Turn any failure into a PluginError, and leave nothing of a plug-in that fails."""
    try:
        with transaction(), limited_code():
            yield
    except PluginError as error:
        raise PluginError(f"plug-in {name}: {error}") from error
    except BaseException as error:
        if ends_command(error):
            raise
        raise PluginError(f"plug-in {name}: {in_one_line(error, __file__)}") from error


def _count_entries() -> int:
    return sum(len(REGISTRIES[kind]) for kind in GROUPS.values() if kind in REGISTRIES)
