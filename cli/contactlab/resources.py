"""Places of the shipped scenes, sweeps and schemas: a checkout's folders or the wheel's copy.

Always real paths, since MuJoCo opens meshes relative to the model file.
"""

import hashlib
import json
import math
import os
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

from contactlab.errors import SceneError, SweepFileError, no_file

try:
    import resource
except ImportError:  # on Windows
    resource = None

_OF_SWEEPS = {".yaml", ".yml"}
_OF_MODELS = {".xml", ".urdf", ".mjcf", ".xacro", ".usd", ".usda"}
RESULTS = Path("results")  # where results go unless a place is named

_INSTALLED = Path(__file__).parent / "_data"
_CHECKOUT = Path(__file__).resolve().parents[2]
_ROOT = _INSTALLED if _INSTALLED.is_dir() else _CHECKOUT


ADVISORIES = _ROOT / "advisories"  # known faults of engines
MODELS, SWEEPS, SCHEMAS = _ROOT / "models", _ROOT / "sweeps", _ROOT / "schemas"
"""The folders of shipped scenes, one folder each, of sweep files and of published schemas."""
ADAPTERS = _ROOT / "adapters"  # of engines that run in environments of their own


def read_style(package: str) -> str:
    """Return the style sheet of a package with pages, `page` or `live`."""
    return Path(__file__).with_name(package).joinpath("style.css").read_text(encoding="utf-8")


def short_hash(parts: Sequence[str]) -> str:
    """Return 12 hexadecimal digits that tell lists of words apart."""
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]


def user_cache() -> Path:
    """Return the folder for files that can be made again; it may not exist."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "contactlab"


def open_user_cache() -> Path | None:
    """Return the folder of `user_cache`, created if needed; None if others may write to it."""
    folder = user_cache()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = folder.stat()
    is_own = status.st_uid == os.geteuid() and not status.st_mode & 0o022
    return folder if is_own else None


def open_file_limit() -> float:
    """Return how many files this process may have open."""
    return _limit_of_process("RLIMIT_NOFILE")


def address_space_limit() -> float:
    """Return the address space that this process may reserve [bytes]."""
    return _limit_of_process("RLIMIT_AS")


@contextmanager
def limited_memory(most_bytes: int) -> Generator[None]:
    """Let allocations of this process fail once it has reserved this much more [bytes].

    Library code in C could otherwise take all memory of the machine.
    """
    try:
        pages = int(Path("/proc/self/statm").read_bytes().split()[0])
    except OSError:
        pages = None
    if resource is None or pages is None:
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    # RLIM_INFINITY is negative.
    finite = [limit for limit in (soft, hard) if limit >= 0]
    lowest = min([pages * resource.getpagesize() + most_bytes, *finite])
    resource.setrlimit(resource.RLIMIT_AS, (lowest, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _limit_of_process(name: str) -> float:
    if resource is None:
        return math.inf
    limit, _ = resource.getrlimit(getattr(resource, name))
    return math.inf if limit == resource.RLIM_INFINITY else limit


def scene_names() -> list[str]:
    """Return the names of the shipped scenes, sorted."""
    return sorted(path.parent.name for path in MODELS.glob("*/scene.yaml"))


def sweep_names() -> list[str]:
    """Return the names of the shipped sweeps, sorted."""
    return sorted(path.stem for path in SWEEPS.glob("*.yaml"))


def scene_folder(name: str) -> Path:
    """Return the folder of a shipped scene; raise SceneError for an unknown name."""
    message, rest = f"no shipped scene named '{name}'", "; see `contactlab list scenes`"
    SceneError.unless_known(name, scene_names(), message, rest=rest)
    return MODELS / name


def sweep_index() -> dict[str, tuple[str, str, int, str]]:
    """Return the rows of `contactlab list sweeps`, by the SHA-256 of the shipped files."""
    return json.loads((SWEEPS / "index.json").read_text(encoding="utf-8"))


def advisory_index() -> dict[str, dict[str, object]]:
    """Return the parsed advisories, by the SHA-256 of the shipped files."""
    return json.loads((ADVISORIES / "index.json").read_text(encoding="utf-8"))


def sweep_file(name: str) -> Path:
    """Return the path of a shipped sweep; raise SweepFileError for an unknown name."""
    message = f"no sweep file and no shipped sweep named '{name}'"
    if name not in sweep_names() and Path(name, "manifest.json").is_file():
        raise SweepFileError(
            f"{name} is a store; read it by `contactlab show {name}`, or join shards by --merge"
        )
    SweepFileError.unless_known(name, sweep_names(), message, rest="; see `contactlab list sweeps`")
    return SWEEPS / f"{name}.yaml"


def find_sweep(name: str) -> Path:
    """Return a sweep file, named by its path or as shipped; raise SweepFileError without one."""
    path = Path(name)
    if path.suffix in _OF_MODELS:
        raise SweepFileError(f"{name} is a model; write a sweep of it: `contactlab init {name}`")
    if path.suffix not in _OF_SWEEPS and "/" not in name and not path.is_file():
        return sweep_file(name)
    if not path.is_file():
        raise SweepFileError(no_file(path, "sweep file", _OF_SWEEPS))
    return path
