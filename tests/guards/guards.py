"""All guards: what each records, and when its test runs."""

from collections.abc import Callable, Iterable
from contextlib import chdir
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from tests.guards.help_texts import help_items
from tests.guards.pages import LONG as LONG_PAGES
from tests.guards.pages import PAGES, page_items
from tests.guards.records import Items, Record, read_record, versions_of, write_record
from tests.guards.schemas import FOLDER as SCHEMAS
from tests.guards.schemas import made_schemas, published_schemas, reordered, schema_items
from tests.guards.sweeps import SWEEPS, planned, simulated, whole_sweep

UPDATE = "make guards"
Tier = Literal["", "long", "night"]
"""The marker of the tests of a guard; the first tier has none."""


class UnavailableError(Exception):
    """What a guard records cannot be made here; the message says why."""


@dataclass(frozen=True)
class Guard:
    """What makes a record.

    Attributes:
        kind: the folder of its record.
        name: the file of its record.
        make: returns results and words, given an empty folder that is the current one.
        packages: those whose versions change the record; it holds under these only.
        modules: modules of an extra that it needs in any version.
        tier: when its test runs.
    """

    kind: str
    name: str
    make: Callable[[Path], tuple[Items, Items]]
    packages: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()
    tier: Tier = ""

    @property
    def key(self) -> str:
        """The place of its record in the folder of all."""
        return f"{self.kind}/{self.name}"

    def versions(self) -> dict[str, str]:
        """Return the installed versions of its packages."""
        return versions_of(self.packages)

    def record(self, folder: Path) -> Record:
        """Make the record in an empty folder.

        Raises:
            UnavailableError: a module or a model is missing.
        """
        for module in self.modules:
            if find_spec(module) is None:
                raise UnavailableError(f"{module} is not installed")
        with chdir(folder):
            return Record(self.versions(), *self.make(folder))

    def read(self) -> Record:
        """Return the stored record; an empty one if there is none."""
        return read_record(self.key)

    def write(self, record: Record) -> bool:
        """Store a record, and return whether it differs from the one before."""
        return write_record(self.key, record)


@dataclass(frozen=True)
class SchemaGuard(Guard):
    """The guard whose record is the folder of published schemas."""

    kind: str = "schemas"
    name: str = "all"
    make: Callable[[Path], tuple[Items, Items]] = lambda _: schema_items(made_schemas())

    def read(self) -> Record:
        """Return the record of the published schemas."""
        published = published_schemas()
        results, words = schema_items(published)
        for name in reordered(published, made_schemas()):
            results["schema"][name]["order and form"] = "not as `make schemas` writes them"
        return Record({}, results, words)

    def write(self, record: Record) -> bool:
        """Publish the schemas, which the record tells apart but does not hold."""
        del record
        before, now = published_schemas(), made_schemas()
        for name, text in now.items():
            (SCHEMAS / name).write_text(text, encoding="utf-8")
        for name in before.keys() - now.keys():
            (SCHEMAS / name).unlink()
        return before != now


def _sweep(name: str, folder: Path) -> tuple[Items, Items]:
    results, words = simulated(name, folder)
    return planned(name) | results, words


_OF_TRACES = ("mujoco", "mcap", "zstandard")
GUARDS: tuple[Guard, ...] = (
    *(Guard("sweeps", name, partial(_sweep, name), _OF_TRACES) for name in SWEEPS),
    Guard("help", "commands", lambda _: ({}, help_items()), ("typer",)),
    SchemaGuard(),
    *(
        Guard(
            "pages",
            name,
            partial(page_items, name),
            ("mujoco", "altair"),
            ("jinja2", "vl_convert"),
            "long" if name in LONG_PAGES else "",
        )
        for name in PAGES
    ),
    *(
        Guard("whole-sweeps", name, partial(whole_sweep, name), _OF_TRACES, tier="night")
        for name in SWEEPS
    ),
)


def guards_of(kinds: Iterable[str], *, slow: bool) -> list[Guard]:
    """Return the guards of some kinds, or of all; the slow ones only if they are wanted or named.

    Raises:
        ValueError: there is no such kind.
    """
    wanted, known = [*kinds], [*dict.fromkeys(guard.kind for guard in GUARDS)]
    for kind in wanted:
        if kind not in known:
            raise ValueError(f"no guard '{kind}'; there are {', '.join(known)}")
    return [
        guard
        for guard in GUARDS
        if (guard.kind in wanted if wanted else slow or guard.tier != "night")
    ]
