"""The way of one value through the program: the files, functions and hops that a reader follows.

Run: python -m bench.way [solref|timestep|friction.slide|model [FILE] [--functions]]

Without a value, it prints the dependencies of modules that no import statement shows, in the source
and as commands run, and the cycles of modules.

With one, one run of a sweep is made in this process (`contactlab sweep FILE --workers 0`), where an
axis has a value that stands nowhere else. At each call of a function of the project and at each
return, its arguments or local variables, its closure among them, are searched for the value: as a
number, in a text, and in tuples, lists, sets and mappings, their keys too, down to three levels. A
named tuple is a tuple; the fields of other objects are not searched, nor arrays: a function that
hands an object on has no need to know what is in it. Counted are the files and the functions that
hold the value at least once, and the hops: how often one event that holds it is in another file
than the one before. The whole is counted first, with the summary that the command prints of the
finished store; then what lies before the store is published, from when on the value is evidence.
Nested functions and comprehensions are functions of their own. A generator, such as that of a
page's template, counts once, however many parts it yields: a reader does not follow each. Bytes are
not searched: they are written results. Imports do not count.

`model` follows the path of a model's file, as text and as `Path`, from the command `contactlab
examine FILE` to its printed verdict; without a FILE, of a small model.
"""

import argparse
import contextlib
import inspect
import io
import sys
import tempfile
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import FrameType

from bench.dependencies import cycles, imports, named_imports, watched_imports

import contactlab
from contactlab.command_line.main import main as command
from contactlab.parts import register_parts
from contactlab.run.sweep_runner import run_sweep

PROJECT = Path(contactlab.__file__).parent
SENTINELS = {
    "solref": ('"0.0137 1"', 0.0137),
    "timestep": ("0.00137", 0.00137),
    "friction.slide": ("0.0137", 0.0137),
}
SWEEP = """
version: 1
scene: ball_drop
duration: 0.02
trace: all
axes: {{{axis}: [{text}]}}
"""
DEPTH = 3
WATCHED = (
    ("--help",),
    ("list", "metrics"),
    ("explain", "drift"),
    ("sweep", "bounce", "--limit", "3", "-o", "store"),
    ("verify", "store"),
    ("report", "store"),
    ("check", "ball_drop", "--check", "task", "-o", "check"),
)
"""Commands whose imports are watched, in one folder."""


@dataclass(frozen=True)
class Stop:
    """One call or return of a function that holds the value."""

    file: str
    function: str


def counts(stops: Sequence[Stop]) -> str:
    """Return how many files and functions a way has, and how often it goes from file to file."""
    files, functions = {stop.file for stop in stops}, set(stops)
    hops = sum(one.file != other.file for one, other in pairwise(stops))
    return f"{len(files)} files, {len(functions)} functions, {hops} hops"


class Way:
    """The functions that hold a value while this is the profile function, in their order."""

    def __init__(self, value: float | str) -> None:
        self._value, self._text = value, value if isinstance(value, str) else f"{value:g}"
        self._importing = 0
        self._generators = dict[int, tuple[FrameType, set[str]]]()  # by id; held, so that ids stay
        self.stops: list[Stop] = []
        self.published = 0  # stops before the store was

    def __call__(self, frame: FrameType, event: str, _result: object) -> None:
        """Note a call or return of a function of the project that holds the value."""
        if event not in ("call", "return"):
            return
        code = frame.f_code
        if code.co_flags & inspect.CO_GENERATOR and self._is_repeated(frame, event):
            return
        if code.co_name == "<module>":
            self._importing += 1 if event == "call" else -1
        file = Path(code.co_filename)
        if self._importing or PROJECT not in file.parents:
            return
        if any(self._holds(local, DEPTH) for local in list(frame.f_locals.values())):
            self.stops.append(Stop(file.relative_to(PROJECT).as_posix(), code.co_qualname))
        if event == "return" and code is run_sweep.__code__:
            self.published = len(self.stops)

    def _is_repeated(self, frame: FrameType, event: str) -> bool:
        """Return whether a generator was called, or has returned a value, before."""
        _, seen = self._generators.setdefault(id(frame), (frame, set()))
        repeated = event in seen
        seen.add(event)
        return repeated

    def _holds(self, held: object, depth: int) -> bool:
        if isinstance(held, float):
            return held == self._value
        if isinstance(held, (str, Path)):
            return self._text in str(held)
        if not depth:
            return False
        if isinstance(held, Mapping):
            return any(
                self._holds(key, depth - 1) or self._holds(value, depth - 1)
                for key, value in list(held.items())
            )
        if isinstance(held, (tuple, list, AbstractSet)):
            return any(self._holds(item, depth - 1) for item in list(held))
        return False


MODEL_NAME = "followed-model.xml"
MODEL = """
<mujoco><option timestep="0.005"/><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
<body name="ball" pos="0 0 .099"><freejoint/><geom type="sphere" size=".1"/></body>
</worldbody></mujoco>
"""


def follow_command(way: Way, words: Sequence[str]) -> str:
    """Run a command in this process, followed by a way, and return its output."""
    sys.argv = ["contactlab", *words]
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.suppress(SystemExit):
        sys.setprofile(way)
        try:
            command()
        finally:
            sys.setprofile(None)
    return output.getvalue()


def follow_model(file: Path | None) -> Way:
    """Examine a model in this process and return the way of its path."""
    way = Way(MODEL_NAME)
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
        model = Path(folder) / MODEL_NAME
        model.write_text(file.read_text(encoding="utf-8") if file else MODEL, encoding="utf-8")
        words = ("examine", str(model), "-o", str(Path(folder) / "results"))
        printed = follow_command(way, words)
        if "task:" not in printed:
            raise RuntimeError(f"the examination failed: {printed}")
    return way


def follow(axis: str) -> Way:
    """Run a sweep of one run in this process and return the way of its value."""
    text, value = SENTINELS[axis]
    way = Way(value)
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
        sweep = Path(folder) / "way.yaml"
        sweep.write_text(SWEEP.format(axis=axis, text=text), encoding="utf-8")
        store = Path(folder) / "store"
        printed = follow_command(way, ("sweep", str(sweep), "-o", str(store), "--workers", "0"))
        if not (store / "manifest.json").is_file():
            raise RuntimeError(f"the sweep failed: {printed}")
    return way


def print_dependencies() -> None:
    """Print dependencies by string and cycles of modules; exit with 1 if there are any."""
    graph = imports(PROJECT)
    found = [f"cycle of modules: {', '.join(cycle)}" for cycle in cycles(graph)]
    found += [f"by a string: {place}" for place in named_imports(PROJECT)]
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
        for words in WATCHED:
            seen = watched_imports(words, Path(folder))
            found += [f"by a string in `contactlab {' '.join(words)}`: {one}" for one in seen]
    edges = sum(map(len, graph.values()))
    print(f"{len(graph)} modules, {edges} imports, {len(WATCHED)} commands watched")
    print("\n".join(found) or "no dependency by a string, no cycle of modules")
    if found:
        raise SystemExit(1)


def main() -> None:
    """Print the counts of one value, and the files in order; or the dependencies of modules."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("axis", choices=[*sorted(SENTINELS), "model"], nargs="?")
    parser.add_argument("file", type=Path, nargs="?", help="of the model")
    parser.add_argument("--functions", action="store_true", help="list the functions of each file")
    asked = parser.parse_args()
    if asked.axis is None:
        print_dependencies()
        return
    way = follow_model(asked.file) if asked.axis == "model" else follow(asked.axis)
    print(counts(way.stops))
    if asked.axis != "model":
        print(f"{counts(way.stops[: way.published])} before it is evidence")
    functions = dict.fromkeys(way.stops)
    for file in dict.fromkeys(stop.file for stop in functions):
        print(f"  {file}")
        for stop in functions if asked.functions else ():
            if stop.file == file:
                print(f"    {stop.function}")


if __name__ == "__main__":
    register_parts()
    main()
