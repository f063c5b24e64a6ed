"""A task for other machines, with the files that they cannot read."""

import pickle
import shutil
from dataclasses import replace
from pathlib import Path

from contactlab.registry import fill_registry
from contactlab.run.tasks import Task

_SCENES, _PLUGINS = "scenes", "plugins"


def pack_bundle(task: Task) -> bytes:
    """Return a task as bytes for other nodes.

    Plug-in files are in the bundle. So are the files of the scene and of its drive if the store is
    not a folder, and has no copy of them that nodes could read.
    """
    scenes = dict[str, bytes]()
    if not isinstance(task.store, Path):
        folder = task.scene_folder.parent
        scenes = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file()
        }
    files = {f"{_SCENES}/{name}": data for name, data in scenes.items()}
    files |= {f"{_PLUGINS}/{p.file.name}": p.file.read_bytes() for p in task.plugins if p.file}
    return pickle.dumps((task, files))


def unpack_bundle(bundle: bytes, folder: Path) -> Task:
    """Return the task of a bundle, after writing the bundle's files into a folder.

    The registry of this process is filled as that of the sweep's process is.
    """
    task, files = pickle.loads(bundle)  # noqa: S301 - our own
    fill_registry(*task.fillers)
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
