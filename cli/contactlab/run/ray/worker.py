"""The worker that a process of a Ray node keeps between jobs, with its engine and its models.

It is a process of its own: if it dies or hangs, its job is reported as on any machine, and the
cluster does not lose the process that waits for it.
"""

import os
import pickle
import platform
import re
import shutil
import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import gettempdir, mkdtemp

from contactlab.run.tasks import Result, Stop, Task
from contactlab.run.worker_pool import WorkerPool

_SCENES, _PLUGINS = "scenes", "plugins"
_OWN_END = re.compile(r"(\d+)-[^-]+")  # the process, and what makes the name of its folder unique
_workers: dict[str, WorkerPool] = {}  # by the token of its sweep; one at most


def pack_bundle(task: Task) -> bytes:
    """Return a task as it is sent to nodes.

    Plug-in files are in the bundle. So are the files of the scene and of its drive if the store is
    no folder, and has no copy of them that nodes could read.
    """
    scenes = {} if isinstance(task.store, Path) else _read(task.scene_folder.parent)
    files = {f"{_SCENES}/{name}": data for name, data in scenes.items()}
    files |= {f"{_PLUGINS}/{p.file.name}": p.file.read_bytes() for p in task.plugins if p.file}
    return pickle.dumps((task, files))


def unpack_bundle(bundle: bytes, folder: Path) -> Task:
    """Return the task of a bundle, after writing the bundle's files into a folder."""
    task, files = pickle.loads(bundle)  # noqa: S301 - our own
    for part in (_SCENES, _PLUGINS):
        shutil.rmtree(folder / part, ignore_errors=True)
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    plugins = tuple(
        replace(plugin, file=folder / _PLUGINS / plugin.file.name) if plugin.file else plugin
        for plugin in task.plugins
    )
    ours = task.scene_folder
    scene = ours if isinstance(task.store, Path) else folder / _SCENES / ours.name
    return replace(task, scene_folder=scene, plugins=plugins)


def run_on_worker(token: str, bundle: Callable[[], bytes], job: bytes) -> Result | Exception:
    """Return the result of a pickled job, or the exception that should end the sweep.

    It runs on the persistent worker, or on a new one if that is of another sweep. The token
    identifies the sweep; the bundle is fetched only for a new worker.
    """
    with _cancellation() as stop:
        try:
            jobs = [pickle.loads(job)]  # noqa: S301 - our own
            return next(_worker(token, bundle).run(jobs, stop), [])
        except Exception as error:  # noqa: BLE001 - raised again where the sweep runs
            return error


def own_folder() -> Path:
    """Make a folder of this process; remove those of processes that are gone."""
    # Machines that share a folder for temporary files do not share their processes.
    name = f"contactlab-of-{platform.node()}-"
    for other in Path(gettempdir()).glob(name + "*-*"):
        # A machine's name may go on where that of another ends.
        own = _OWN_END.fullmatch(other.name.removeprefix(name))
        if own and not Path("/proc", own[1]).exists():
            shutil.rmtree(other, ignore_errors=True)
    return Path(mkdtemp(prefix=f"{name}{os.getpid()}-"))


def _worker(token: str, bundle: Callable[[], bytes]) -> WorkerPool:
    if token not in _workers:
        for other in _workers.values():
            other.close()
        _workers.clear()
        folder = own_folder()
        _workers[token] = WorkerPool(unpack_bundle(bundle(), folder), folder, 1)
    return _workers[token]


@contextmanager
def _cancellation() -> Generator[Stop]:
    """Yield a stop that is set when the cluster cancels the job, which it does as Ctrl-C would."""
    stop = Stop()
    before = signal.signal(signal.SIGINT, lambda *_: stop.set())
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


def _read(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }
