"""All guards: the kind of each, the function that makes its record, and the tier of its test."""

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import chdir
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from tests.guards.examined import case_items, robot_items
from tests.guards.help_texts import help_items
from tests.guards.pages import LONG as LONG_PAGES
from tests.guards.pages import PAGES, page_items
from tests.guards.records import Items, Record, read_record, versions_of, write_record
from tests.guards.robots import Robot, UnavailableError, pinned_robots
from tests.guards.schemas import FOLDER as SCHEMAS
from tests.guards.schemas import made_schemas, published_schemas, reordered, schema_items
from tests.guards.sweeps import SWEEPS, planned, simulated, whole_sweep
from tests.guards.written import written_items
from tests.verdicts.corpus import FOLDER as CORPUS
from tests.verdicts.corpus import Case, read_part

UPDATE = "make guards"
Tier = Literal["", "long", "night"]
"""The marker of the tests of a guard; the first tier has none."""


@dataclass(frozen=True)
class Guard:
    """The maker of a record.

    Attributes:
        kind: the folder of its record.
        name: the file of its record.
        make: returns results and words, given an empty folder that is the current one.
        packages: their versions change the record, which holds under these versions only.
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
        with chdir(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Models of others have deprecated attributes.
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


def _of_case(case: Case, _: Path) -> tuple[Items, Items]:
    return case_items(case)


def _file_name(case: str) -> str:
    return case.replace(" ", "-").replace("'", "")


def _examined(robot: Robot, _: Path) -> tuple[Items, Items]:
    return robot_items(robot.name, robot.find())


def _written(robot: Robot, _: Path) -> tuple[Items, Items]:
    return written_items(robot.name, robot.find())


def _open_cases() -> Iterator[Case]:
    """Yield the cases of all parts but those that are held back, which no guard may look into."""
    for file in sorted(CORPUS.glob("*/truth.json")):
        if not file.parent.name.startswith("held_back"):
            yield from read_part(file.parent).cases


QUICK_CASES = {"rate feedback on a spinning wheel"}
"""Cases of the first tier, which take about a second."""
QUICK_SWEEPS = {"bounce", "impact", "slide", "stack", "tradeoff-ball"}
"""Sweeps of the first tier: one of each kind of contact."""
_OF_TRACES = ("mujoco", "mcap", "zstandard")
_OF_VERDICTS = ("mujoco", "numpy", "scipy")
GUARDS: tuple[Guard, ...] = (
    *(
        Guard(
            "sweeps",
            name,
            partial(_sweep, name),
            _OF_TRACES,
            tier="" if name in QUICK_SWEEPS else "long",
        )
        for name in SWEEPS
    ),
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
    *(
        Guard(
            "corpus",
            _file_name(case.name),
            partial(_of_case, case),
            _OF_VERDICTS,
            tier="" if case.name in QUICK_CASES else "night",
        )
        for case in _open_cases()
    ),
    *(
        Guard("robots", robot.name, partial(_examined, robot), _OF_VERDICTS, tier="night")
        for robot in pinned_robots()
    ),
    *(
        Guard("written", robot.name, partial(_written, robot), _OF_VERDICTS, tier="night")
        for robot in pinned_robots()
        if robot.written
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
