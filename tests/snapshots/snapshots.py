"""All snapshots: what they are called, what makes their texts, and what the texts depend on.

A snapshot is a text in `texts/`. Its first line names the packages whose versions show in it; it
holds under these versions only.
"""

import tempfile
from collections.abc import Callable, Mapping
from contextlib import chdir
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from tests.snapshots.help_texts import help_text
from tests.snapshots.page_facts import page_text
from tests.snapshots.sweep_facts import SWEEPS, sweep_text

TEXTS = Path(__file__).with_name("texts")
UPDATE = "make snapshots"


@dataclass(frozen=True)
class Snapshot:
    """What makes a text, given an empty folder, and the packages whose versions show in it."""

    make: Callable[[Path], str]
    packages: tuple[str, ...]
    # Modules of an extra that it needs as well, in any version.
    modules: tuple[str, ...] = ()

    def versions(self) -> str:
        """Return the packages and their installed versions."""
        return stated({name: _version(name) for name in self.packages})

    def text(self, folder: Path) -> str:
        """Return the text, made in an empty folder that is the current one meanwhile."""
        with chdir(folder):
            return f"{self.versions()}\n\n{self.make(folder)}"


SNAPSHOTS: Mapping[str, Snapshot] = {
    "help": Snapshot(lambda _: help_text(), ("typer",)),
    "page": Snapshot(page_text, ("mujoco", "altair"), ("jinja2", "vl_convert")),
    **{f"sweep-{name}": Snapshot(partial(sweep_text, name), ("mujoco",)) for name in SWEEPS},
}


def stated(versions: Mapping[str, str]) -> str:
    """Return versions by package as the first line of a text states them."""
    return ", ".join(f"{name} {number}" for name, number in versions.items())


def path_of(name: str) -> Path:
    """Return where the text of a snapshot is."""
    return TEXTS / f"{name}.txt"


def write_snapshots() -> list[Path]:
    """Make the texts of all snapshots, and return the files that changed or that went."""
    TEXTS.mkdir(exist_ok=True)
    changed = [path for path in TEXTS.iterdir() if path.stem not in SNAPSHOTS]
    for path in changed:
        path.unlink()
    for name, snapshot in SNAPSHOTS.items():
        with tempfile.TemporaryDirectory() as folder:
            text = snapshot.text(Path(folder))
        path = path_of(name)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            changed.append(path)
    return changed


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
