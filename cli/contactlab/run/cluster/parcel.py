"""What all jobs of a sweep have in common, as it is sent to the nodes.

A store that is no folder has no copy of the scene that nodes could read, so the scene's files go
along.
"""

import os
import pickle
import platform
import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import gettempdir, mkdtemp

from contactlab.run.job import Task

_SCENE = "scene"


def packed(task: Task) -> bytes:
    """Return a task with what it needs there."""
    folder = task.scene_folder
    files = {} if isinstance(task.store, Path) else _read(folder)
    return pickle.dumps((task, files))


def unpacked(parcel: bytes, folder: Path) -> Task:
    """Return a task, and write what came with it into a folder of this process."""
    task, files = pickle.loads(parcel)  # noqa: S301 - our own
    if not files:
        return task
    scene = folder / _SCENE
    shutil.rmtree(scene, ignore_errors=True)
    for name, data in files.items():
        (scene / name).parent.mkdir(parents=True, exist_ok=True)
        (scene / name).write_bytes(data)
    return replace(task, scene_folder=scene)


def own_folder() -> Path:
    """Make a folder of this process; remove those of processes that are gone."""
    # Machines that share a folder for such files do not share their processes.
    name = f"contactlab-of-{platform.node()}-"
    for other in Path(gettempdir()).glob(name + "*-*"):
        process = other.name.removeprefix(name).partition("-")[0]
        if not Path("/proc", process).exists():
            shutil.rmtree(other, ignore_errors=True)
    return Path(mkdtemp(prefix=f"{name}{os.getpid()}-"))


def _read(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }
