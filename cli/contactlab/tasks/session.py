"""Parts that every study shares: the session that it runs in, and settings given as options."""

import fcntl
import json
import os
import re
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

from contactlab.errors import OtherSweepError, OutputError, StoreError, SweepFileError
from contactlab.plan.overrides import Overrides
from contactlab.plan.sweep_file import read_sweep
from contactlab.run.planned_runs import keep_scene
from contactlab.run.sweep_request import SceneLoader, SweepRequest
from contactlab.run.sweep_runner import run_sweep
from contactlab.run.tasks import BeginCallback, FinishedRun, Stop
from contactlab.schema.sweep_schema import Sweep
from contactlab.store.atomic_files import atomic_write, write_errors
from contactlab.store.finished_store import Store
from contactlab.store.store_files import read_stored

CLAIMS = "sources.json"  # the models and scenes that a folder of studies has results of
REMOVE = "remove it, or write elsewhere with -o"
"""The advice if a folder of studies has a store that cannot be resumed."""
Values = Mapping[str, object]  # canonical values by axis
_Kind = TypeVar("_Kind")


def _ignore(*_: object) -> None:
    """Take a callback's arguments, and do nothing."""


@dataclass(frozen=True)
class Session:
    """Where and how a study runs its sweeps."""

    folder: Path  # receives the stores of the study, each under its own name, and its reports
    workers: int = 0  # worker processes; 0 runs everything in this process
    begin: BeginCallback = _ignore  # called when the runs of a sweep, or a pass over them, begin
    progress: Callable[[Sequence[FinishedRun]], None] = _ignore  # called with runs as they finish
    # Called with a line of text, where there is something to tell before the report.
    notify: Callable[[str], None] = _ignore
    stop: Stop | None = None  # set, from another thread or a signal handler, to end the study early
    allow_code: bool = False  # whether policies may run, which are code
    # Those of the sweeps that studies made up, by name.
    stores: dict[str, Store] = field(default_factory=dict[str, Store])

    def claim(self, results: str, reference: str) -> None:
        """Take the folder's one place for such results; an OutputError if it has another's."""
        source = source_of(reference)
        claimed = self.read(CLAIMS, dict[str, str])
        if claimed.setdefault(results, source) != source:
            raise OutputError(
                f"{self.folder} has the results of {claimed[results]}; write elsewhere with -o"
            )
        self.write({CLAIMS: json.dumps(claimed, indent=2) + "\n"})

    def read(self, name: str, kind: type[_Kind]) -> _Kind:
        """Return the content of a file, or nothing; an OutputError if it is damaged."""
        try:
            return TypeAdapter(kind).validate_json(read_stored(self.folder, name) or b"{}")
        except ValidationError as error:
            raise OutputError(f"{self.folder / name} is damaged; remove it") from error

    def run(self, sweep: SweepRequest) -> Store:
        """Run a sweep and open its store.

        Raises an OutputError if it cannot be written; an OtherSweepError if it is another's; a
        StoppedError if `stop` was set: resume it.
        """
        sweep = replace(sweep, allow_code=self.allow_code)
        try:
            run_sweep(sweep, self.begin, self.progress, self.stop)
        except OtherSweepError as error:
            raise OtherSweepError(error.held, REMOVE) from error
        return Store.open(sweep.store)

    def run_derived(
        self, name: str, sweep: Mapping[str, object], scenes: SceneLoader, *, resume: bool = False
    ) -> Store:
        """Run a sweep that a study makes up, as data, into a store of the folder, replacing any.

        To resume, the runs of a store of the same sweep are kept.
        """
        sweep_file = read_sweep(sweep, scenes.vocabulary)
        scene, plan = scenes.for_sweep(sweep_file)
        request = SweepRequest(
            plan=plan,
            scene=scene,
            name=name,
            source=sweep_file.text,
            overrides=(),
            store=self.folder / name,
            workers=self.workers,
            fresh=not resume,
        )
        try:
            store = self.run(request)
        except StoreError:
            if not resume:
                raise
            store = self.run(replace(request, fresh=True))
        keep_scene(store, scene)
        self.stores[name] = store
        return store

    def write(self, files: Mapping[str, str]) -> None:
        """Write text files into the session's folder, by name; an OutputError if one cannot be."""
        with write_errors(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            with atomic_write(self.folder / name) as path:
                path.write_text(text, encoding="utf-8")


def source_of(reference: str) -> str:
    """Return the unique name of a model: its path, or the name of a scene or a robot."""
    path = Path(reference).expanduser()
    return str(path.resolve()) if path.exists() else reference


@contextmanager
def free_folder(
    parent: Path, results: str, reference: str, variant: Sequence[str] = ()
) -> Generator[Path]:
    """Yield a folder for a model's results, which no other command uses until the context ends.

    It has the model's name and its variant, such as changed settings; a number follows if another
    model or a running command has it. Other content of such a folder is left alone.
    """
    name, source = model_name(reference), source_of(reference)
    most_letters = 80  # of a name that a person still reads, and that every file system takes
    name = re.sub(r"[^\w.=+-]+", "_", ",".join([name, *variant]))[:most_letters]
    for folder in _number_folders(parent, name):
        if folder.exists() and not folder.is_dir():
            continue
        claimed = Session(folder).read(CLAIMS, dict[str, str])
        if folder.exists() and claimed.get(results) != source:
            continue
        new_folders = [each for each in (folder, *folder.parents) if not each.exists()]
        with write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            lock = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
            continue
        try:
            yield folder
        finally:
            os.close(lock)
            with suppress(OSError):  # not empty
                for each in new_folders:
                    each.rmdir()
        return


def own_folder(parent: Path, reference: str) -> Path:
    """Return the folder for a subject's results of a study: the first that no other subject has.

    It has the subject's name, and lies in a folder with the name of the study.
    """
    name, source = model_name(reference), source_of(reference)
    return next(
        folder
        for folder in _number_folders(parent, name)
        if Session(folder).read(CLAIMS, dict[str, str]).get(parent.name, source) == source
    )


def _number_folders(parent: Path, name: str) -> Iterator[Path]:
    return (parent / (name if number == 1 else f"{name}-{number}") for number in count(1))


def model_name(reference: str) -> str:
    """Return a name for a model's folder: of its folder and its file, without repetition."""
    path = Path(reference.rpartition(":")[2].rstrip("/"))
    stem, folder = path.stem or "model", path.parent.name if path.suffix or ":" in reference else ""
    words, folder_words = ({*re.split(r"[\W_]+", text)} for text in (stem, folder))
    return (
        stem if not folder or words <= folder_words or folder_words <= words else f"{folder}-{stem}"
    )


def read_settings(
    scenes: SceneLoader, reference: str, assign: Sequence[str], keys: Collection[str] = ()
) -> tuple[Values, Sweep]:
    """Return values by axis of options `--set`, and the sweep that these make.

    The options give one value to each of some axes of a scene, and may set these keys of a sweep.
    Raises a SweepFileError if an option is wrong, or gives more than one value (all that do are
    named); a SceneError if there is no such scene.
    """
    scenes.vocabulary(reference)  # refuses a wrong model before there is a file to name
    sweep_file = read_sweep(
        {"version": 1, "scene": reference}, scenes.vocabulary, Overrides(assign)
    )
    given_keys = sweep_file.sweep.model_dump(exclude_defaults=True).keys()
    if foreign := sorted(given_keys - {"version", "scene", "axes", *keys}):
        *first, last = ["axes of the scene", *keys]
        names = " and ".join(filter(None, (", ".join(first), last)))
        raise SweepFileError(f"--set {foreign[0]}: this command takes {names} only")
    for axis in sweep_file.plan.axes:
        if axis.count > 1:
            raise SweepFileError(
                f"--set {axis.name}: give one value, not {axis.count}; "
                "to compare several, write a sweep"
            )
    return next(sweep_file.plan.iterate_runs()).values, sweep_file.sweep
