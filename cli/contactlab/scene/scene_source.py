"""Finds a scene's files, their hash, and its manifest from the scene's reference in a sweep.

A scene is a shipped name, a folder with a manifest, a model file, or a robot of MuJoCo Menagerie:
`menagerie:ROBOT[/ENTRY]`.
"""

import importlib
from collections.abc import Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from contactlab import resources
from contactlab.errors import SceneError, install_command, no_file
from contactlab.plugins import find_extensions
from contactlab.scene.model_files import SceneFiles, collect_files, relative_path
from contactlab.scene.model_guards import check_places
from contactlab.scene.model_xml import Elements, list_elements, parse_model
from contactlab.schema.drive import drive_files
from contactlab.schema.explained_errors import explain_file_errors
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.strict_model import check_extent

_MENAGERIE_SCHEME, _ENVIRONMENT_SCHEME = "menagerie:", "environment:"


def is_menagerie(reference: str) -> bool:
    """Return whether a scene's reference names a robot of MuJoCo Menagerie."""
    return reference.startswith(_MENAGERIE_SCHEME)


def menagerie_name(reference: str) -> str:
    """Return the name of a robot's scene as a file name: `franka_emika_panda-panda`."""
    return reference.removeprefix(_MENAGERIE_SCHEME).replace("/", "-")


def menagerie_model(reference: str) -> Path:
    """Return the model file of a robot, which the package downloads on first use.

    Without an entry it is the robot's default: its scene if it has one. A SceneError says that the
    package is not installed, knows no such robot or entry, or cannot get it.
    """
    try:
        package = importlib.import_module("mujoco_menagerie")
    except ModuleNotFoundError as error:
        raise SceneError(
            f"'{reference}' needs mujoco-menagerie, which is not installed; "
            f"{install_command('menagerie')}"
        ) from error
    robot, _, entry = reference.removeprefix(_MENAGERIE_SCHEME).partition("/")
    robots: list[str] = package.names()
    message, listing = f"MuJoCo Menagerie has no robot '{robot}'", "`mujoco-menagerie names`"
    SceneError.unless_known(robot, robots, message, f"; {listing} lists them")
    entries: list[str] = package.get(robot).entry_names
    if entry:
        message = f"{robot} of MuJoCo Menagerie has no entry '{entry}'"
        SceneError.unless_known(entry, entries, message, f"; write one of {', '.join(entries)}")
    try:
        path = Path(package.get(robot).xml(entry or None))
    except (package.MenagerieError, OSError) as error:
        raise SceneError(
            f"cannot get {robot}: {error}\n"
            "robots are downloaded on first use; without a network, set MENAGERIE_ROOT to a folder "
            "of robots, such as a checkout of mujoco_menagerie"
        ) from error
    if not path.is_file():
        raise SceneError(f"{path.parent} has no {path.name}, the file of '{reference}'")
    return path


MANIFEST = "scene.yaml"
MODEL_SUFFIXES = {".xml", ".urdf", ".mjcf"}
BINARY = ".mjb"
"""Suffix of a compiled model, such as that of a loop or an environment; it takes no new sensors."""
_USD_HINT = "is USD, which MuJoCo does not read; export it as MJCF or URDF"
_MESH_HINT = (
    "is a mesh, not a model; write an MJCF model with it as an asset: <mesh file={name!r}/>"
)
FOREIGN_SUFFIXES: Mapping[str, str] = {
    ".xacro": "is a template of a model; expand it first: `xacro {name} > {stem}.urdf`",
    BINARY: "is compiled; name the MJCF or URDF that it was compiled from",
    ".mjcf": "has an ending that MuJoCo does not read; rename it to {stem}.xml",
    ".sdf": "is SDF, which MuJoCo does not read; export it as MJCF or URDF",
    **dict.fromkeys((".usd", ".usda", ".usdc", ".usdz"), _USD_HINT),
    **dict.fromkeys((".obj", ".stl", ".dae", ".ply", ".msh", ".glb"), _MESH_HINT),
}
"""Kinds of files that are not models, by suffix, and how to convert them."""


@dataclass(frozen=True)
class SceneSource:
    """A scene on disk, at the path of its manifest or, without one, of its model.

    Its name is the shipped name, the stem of the folder or file, or robot and entry.
    """

    name: str
    path: Path
    manifest: SceneManifest | None
    content: SceneFiles
    environment: Any = None  # the object of another package that opens and plays it

    @property
    def model(self) -> Path:
        """The model file."""
        return self.content.root / self.content.model

    @cached_property
    def elements(self) -> Elements:
        """The elements of the model's XML files; none of other files."""
        files = (self.content.root / name for name in self.content.files)
        all_elements = list[tuple[str, Mapping[str, str]]]()
        for path in files:
            if path.suffix in MODEL_SUFFIXES:
                with suppress(SceneError):
                    all_elements += list_elements(parse_model(path))
        return all_elements

    @contextmanager
    def named_in_errors(self) -> Generator[None]:
        """Name the scene's file in an error that is raised within."""
        try:
            yield
        except SceneError as error:
            raise SceneError(f"{self.path}: {error}") from error


def find_scene(
    reference: str, base: Path | None = None, *, allow_code: bool = False
) -> SceneSource:
    """Return the scene of a name, a folder with a manifest, a model file, a robot, an environment.

    Relative paths start in the base folder, or in the working directory. A SceneError says that the
    scene does not exist, that its manifest is invalid, or that its code is not allowed.
    """
    if reference.startswith(_ENVIRONMENT_SCHEME):
        advice = reference.removeprefix(_ENVIRONMENT_SCHEME)
        return _open_environment(advice, base or Path()).open(None, allow_code)
    if is_menagerie(reference):
        return _scene_of_model(menagerie_model(reference), menagerie_name(reference))
    path = (base or Path()) / Path(reference).expanduser()
    if foreign := FOREIGN_SUFFIXES.get(path.suffix.lower()):
        plain = path.name.partition(".")[0]
        raise SceneError(f"{path}: {foreign.format(name=path.name, stem=plain)}")
    if path.suffix in MODEL_SUFFIXES:
        return _scene_of_model(path, path.stem)
    if path.exists() and not path.is_dir():
        raise SceneError(f"{path}: not a model; name an .xml or .urdf file")
    if path.is_dir() and not (path / MANIFEST).is_file():
        models = sorted(each for each in path.iterdir() if each.suffix in MODEL_SUFFIXES)
        advice = " or ".join(map(str, models[:3])) or "an .xml or .urdf file; it has none"
        if len(models) > 3:
            advice = f"one of its {len(models)} models, as {advice}"
        raise SceneError(f"{path} has no {MANIFEST}; name {advice}")
    if "/" in reference or (path / MANIFEST).is_file():
        return _scene_of_folder(path, path.resolve().name, allow_code=allow_code)
    if path.suffix and not path.exists():
        raise SceneError(no_file(path, "model file", MODEL_SUFFIXES))
    return _scene_of_folder(resources.scene_folder(reference), reference)


def reference_from(folder: Path, reference: str) -> str:
    """Return a scene's reference relative to a folder, from that in the working directory."""
    path = Path(reference).expanduser()
    is_path = path.suffix in MODEL_SUFFIXES or (path / MANIFEST).is_file() or "/" in reference
    if is_menagerie(reference) or not is_path:
        return reference
    relative = relative_path(path, folder).as_posix()
    return relative if path.suffix in MODEL_SUFFIXES else f"{relative}/"


def stored_scene(folder: Path, model: str, name: str) -> SceneSource:
    """Return a scene that was copied into a store's folder, which has no other files."""
    # Only the scene's own files were copied, so any manifest among them is the scene's.
    return copied_scene(folder, model, next(folder.rglob(MANIFEST), None), name)


def copied_scene(folder: Path, model: str, manifest: Path | None, name: str) -> SceneSource:
    """Return a scene that was copied into a folder, with its model's path there.

    The manifest is the copy of the scene's own, or None for a bare model.
    """
    if manifest is not None:
        return _scene_of_folder(manifest.parent, name, copy=folder)
    return _scene_of_model(folder / model, name, copy=folder)


def _scene_of_model(path: Path, name: str, copy: Path | None = None) -> SceneSource:
    if not path.is_file():
        raise SceneError(no_file(path, "model file", MODEL_SUFFIXES))
    return SceneSource(name, path, None, collect_files(path, copy=copy))


def _open_environment(name: str, folder: Path) -> Any:  # noqa: ANN401 - of another package
    return find_extensions("environment")["mujoco"].load()(name, folder.absolute())


def _scene_of_folder(
    path: Path, name: str, copy: Path | None = None, *, allow_code: bool = False
) -> SceneSource:
    manifest = path / MANIFEST
    if not manifest.is_file():
        raise SceneError(
            f"{path} has no {MANIFEST}; to run without one, name the model file itself"
        )
    check_places([manifest], path, copy)
    declared = read_manifest(manifest)
    environment = declared.environment and _open_environment(declared.environment, path)
    if environment and copy is None:
        return environment.open(declared, allow_code)
    if declared.model.endswith(BINARY) and copy is None:
        raise SceneError(
            f"{path / declared.model} is compiled; name the MJCF or URDF that it was compiled from"
        )
    recorded = [declared.recording.file] if declared.recording else []
    other_files = [path / file for file in (*drive_files(declared.drive), *recorded)]
    other_files += environment.files if environment else ()
    files = collect_files(path / declared.model, [manifest, *other_files], copy)
    return SceneSource(name, manifest, declared, files, environment)


def read_manifest(path: Path) -> SceneManifest:
    """Read a scene's manifest. Raises a SceneError if it is not YAML, or with all wrong keys."""
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415 - most models are no scene

    text = ""
    try:
        text = path.read_text(encoding="utf-8-sig")
        return _parse_manifest(text)
    except ValidationError as error:
        mistakes = explain_file_errors(error, SceneManifest, text)
        raise SceneError("\n  ".join([f"{path}: invalid manifest", *mistakes])) from error
    except TypeError as error:
        raise SceneError(f"{path}: not YAML of a manifest: a key is a list or a mapping") from error
    except (YAMLError, ValueError, OSError, RecursionError) as error:
        raise SceneError(f"{path}: not YAML: {error}") from error


@lru_cache(maxsize=4)
def _parse_manifest(text: str) -> SceneManifest:
    """Return the manifest in a YAML text, cached for a sweep's process and its forked workers."""
    from ruamel.yaml import YAML  # noqa: PLC0415 - as above

    check_extent(text)
    yaml = YAML(typ="safe", pure=True)
    yaml.composer.warn_double_anchors = False
    return SceneManifest.model_validate(yaml.load(text))
