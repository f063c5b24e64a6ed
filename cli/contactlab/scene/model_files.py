"""The files of a model: its references, their places, and a copy that is the same model.

Which files a model refers to follows MuJoCo's XML reference (compiler, include, asset), tried on
MuJoCo 3.17 and 4.0. MuJoCo takes ROS resource names, `package://NAME/PATH` and `model://NAME/PATH`,
for plain paths, which never exist; here they are looked up. A store's copy has the unchanged
models; their absolute paths are looked up within the copy.
"""

import hashlib
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from contactlab.errors import SceneError
from contactlab.scene.model_guards import OUTERMOST, ModelSize, Nesting, check_picture, check_places
from contactlab.scene.model_xml import FILE_KEYS, FOLDER_KEYS, parse_model

ASSET_FOLDERS = {
    "mesh": "meshdir",
    "skin": "meshdir",
    "hfield": "meshdir",
    "texture": "texturedir",
    "flexcomp": "meshdir",
}
"""The elements that read files, by tag, and the compiler's attribute that names their folder."""


@dataclass(frozen=True)
class Reference:
    """A file that a model refers to, where it is or is expected.

    It is named by a ROS resource name, by an absolute path, or neither.
    """

    path: Path
    resource: str = ""
    absolute: bool = False

    @property
    def place(self) -> Path:
        """Folder of the package that the file lies in, if any, or its own path."""
        if self.resource:
            package, rest = _package_and_path(self.resource)
            folder = self.path.parents[len(Path(rest).parts) - 1]
            if folder.name == package:
                return folder
        return self.path


@dataclass
class _Counts:
    """Elements of one model with its includes, and copies of each model that it attaches."""

    elements: float = 0.0
    attached: dict[str, float] = field(default_factory=dict[str, float])
    read_paths: set[Path] = field(default_factory=set[Path])
    """Its files, by the paths that it names: the same file elsewhere refers to other files."""


@contextmanager
def named_in_errors(path: Path) -> Generator[None]:
    """Name a file in an error that is raised within."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error


@dataclass(frozen=True)
class FileSearch:
    """A search for the files of a model, which a store's copy may hold; it reads each once."""

    copy: Path | None = None
    size: ModelSize = field(default_factory=ModelSize)

    def iterate_references(self, model: Path, within: tuple[Path, ...] = ()) -> Iterator[Reference]:
        """Yield the files that an MJCF or URDF file refers to, existing or not.

        A SceneError names it, or a model that it includes or attaches, if missing or not XML, or
        `within` itself.
        """
        own = _make_plain_path(model)
        is_binary = model.suffix == ".mjb" and not within
        if is_binary or own in self.size.expanded:
            return
        within, counts = append_file(model, within), _Counts()
        elements = list(self._iterate_elements(Reference(model), model.parent, within, counts))
        compiler = merge_compilers(elements[0][0], (element for element, _ in elements))
        yield from (file for _, file in elements if file.path != model)
        for element, file in elements:
            if element.tag == "model" and element.get("file"):
                attached = self.find_model(element, file.path, model.parent)
                yield attached
                yield from self.iterate_references(attached.path, within)
                # A model without a name has that of its file, or of its root.
                times = counts.attached.get(element.get("name", ""), sum(counts.attached.values()))
                counts.elements += times * self.size.expanded[_make_plain_path(attached.path)]
                with named_in_errors(model):
                    self.size.check_elements("all that it attaches", counts.elements)
            yield from self.find_assets(element, file.path, model.parent, compiler).values()
        self.size.expanded[own] = counts.elements

    def _iterate_elements(
        self,
        file: Reference,
        base: Path,
        within: tuple[Path, ...],
        counts: "_Counts",
        outer: Nesting = OUTERMOST,
    ) -> Iterator[tuple[ET.Element, Reference]]:
        """Yield every element in document order, includes in their place, with its file."""
        own = _make_plain_path(file.path)
        if own not in counts.read_paths:
            counts.read_paths.add(own)
            root = parse_model(file.path)
            with named_in_errors(file.path):
                elements, nestings = self.size.count_elements(root, counts.attached, outer)
                counts.elements += elements
                self.size.check_elements("all that it includes", counts.elements)
            for element in root.iter():
                yield element, file
                if element.tag == "include":
                    inner = self.find_model(element, file.path, base)
                    paths = append_file(inner.path, within)
                    yield from self._iterate_elements(inner, base, paths, counts, nestings[element])

    def find_model(self, element: ET.Element, file: Path, base: Path) -> Reference:
        """Return the file that an <include> or <model> names, in a model of a base folder."""
        name = element.get("file", "")
        reference, nearby = (self.find_file(folder, name) for folder in (base, file.parent))
        is_right = reference.path.is_file() or not nearby.path.is_file()
        return reference if is_right else nearby

    def find_assets(
        self, element: ET.Element, file: Path, base: Path, compiler: Mapping[str, str]
    ) -> Mapping[str, Reference]:
        """Return the files that an element of a file reads, by attribute.

        They are named from the folder of the model; what is not there, from that of an included
        file which names it, and then without the compiler's folder.
        """
        if element.tag not in ASSET_FOLDERS:
            return {}
        folder = compiler.get(ASSET_FOLDERS[element.tag], "")
        strip = compiler.get("strippath", "").lower() == "true"
        assets = dict[str, Reference]()
        for key in FILE_KEYS:
            if not (name := element.get(key)):
                continue
            if _RESOURCE.fullmatch(name) and not strip:
                assets[key] = Reference(_find_resource(name, base, self.copy), resource=name)
                continue
            name = Path(name).name if strip else name
            assets[key] = self.find_file(base, Path(folder) / name)
            nearby = self.find_file(file.parent, name)
            if not assets[key].path.is_file() and nearby.path.is_file():
                assets[key] = nearby
        return assets

    def find_file(self, base: Path, name: str | Path) -> Reference:
        """Return the file that a model in a folder names."""
        if not Path(name).is_absolute():
            return Reference(base / name)
        return Reference(
            _in_copy(Path(name), self.copy) if self.copy else Path(name), absolute=True
        )


def merge_compilers(root: ET.Element, elements: Iterable[ET.Element]) -> dict[str, str]:
    """Return the compiler settings of a model with this root; of two elements the last one wins.

    MuJoCo reads one <compiler> of a URDF file, that of its <mujoco>.
    """
    is_urdf = root.tag.lower() == "robot"
    compiler = dict[str, str]()
    for element in root.findall("mujoco/compiler") if is_urdf else elements:
        if element.tag == "compiler":
            if (folder := element.get("assetdir")) is not None:
                compiler.update(meshdir=folder, texturedir=folder)
            compiler.update(element.attrib)
    return compiler


def append_file(model: Path, within: tuple[Path, ...]) -> tuple[Path, ...]:
    """Return the files that a file is read within, and itself; a SceneError if that has no end."""
    own = model.resolve()
    if own in within:
        by = f", by {within[-1].name}" if within[-1] != own else ""
        raise SceneError(f"{model}: is included or attached within itself{by}; remove that element")
    return (*within, own)


def _in_copy(path: Path, copy: Path) -> Path:
    """Return the place in a copy of a file with an absolute path; that path if it is not there."""
    tails = (copy.joinpath(*path.parts[start:]) for start in range(1, len(path.parts) + 1))
    return next((tail for tail in tails if tail.exists()), path)


def name_in_copy(root: ET.Element, copy: Path) -> None:
    """Have a model of a copy name the copy's files where it names them by absolute paths."""
    for element in root.iter():
        for key in (*FILE_KEYS, *FOLDER_KEYS):
            if (path := Path(element.get(key, ""))).is_absolute():
                element.set(key, str(_in_copy(path, copy)))


_RESOURCE = re.compile(r"(?:package|model):/+([^/]+)/(.+)")


def plain_name(resource: str) -> str:
    """Return a resource name with single slashes, as MuJoCo has it after some steps."""
    return re.sub("/+", "/", resource)


def _package_and_path(resource: str) -> tuple[str, str]:
    parts = _RESOURCE.fullmatch(resource)
    assert parts is not None
    return parts[1], parts[2]


def _find_resource(name: str, folder: Path, copy: Path | None) -> Path:
    """Return the path of a ROS resource; where it is expected, if it does not exist.

    A package is a folder of that name that holds the model or lies next to a folder that does. So
    that parts of a package work too, any folder above the model may stand for it.
    """
    package, rest = _package_and_path(name)
    above = [
        parent for parent in (folder, *folder.parents) if not copy or parent.is_relative_to(copy)
    ]
    places = [parent / rest for parent in above if parent.name == package][:1]
    places += [parent / part for parent in above for part in (f"{package}/{rest}", rest)]
    return next((place for place in places if place.is_file()), places[0])


@dataclass(frozen=True)
class SceneFiles:
    """The files of a scene."""

    root: Path  # the folder that holds them all, and the folders of the packages that they name
    model: Path  # the model file, relative to the root
    files: tuple[Path, ...]  # every file, relative to the root, sorted
    licences: tuple[Path, ...]  # licence files of the folders that hold the files, up to the root
    resources: Mapping[str, Path]  # files that models name by ROS resource names, by `plain_name`
    copied: bool  # whether these are a store's copy
    absolute: bool  # whether a model names files by absolute paths
    hash: str  # SHA-256 over names and bytes of the files, shortened to 16 hex digits

    def count_bytes(self) -> int:
        """Return the size of all files that a copy has."""
        return sum((self.root / file).stat().st_size for file in (*self.files, *self.licences))

    def copy_to(self, folder: Path) -> None:
        """Copy every file into the folder, licences with them, keeping their places."""
        for file in (*self.files, *self.licences):
            target = folder / file
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.root / file, target)


def collect_files(
    model: Path, scene_files: Sequence[Path] = (), copy: Path | None = None
) -> SceneFiles:
    """Return the model file, its includes and assets, the manifest and its files, if any.

    Missing assets are left for the compiler to report: it does not need them all. Besides the model
    are the manifest and the files that it names; the folder of a store's copy may hold them. A
    SceneError names a file that cannot be read, is not XML, or is not the scene's to name.
    """
    model, others = _make_plain_path(model), set(map(_make_plain_path, scene_files))
    try:
        search = FileSearch(copy and _make_plain_path(copy))
        references = list(search.iterate_references(model))
        paths = {model, *others, *(_make_plain_path(reference.path) for reference in references)}
        check_places(paths, scene_files[0].parent if scene_files else model, copy)
        existing = [reference for reference in references if reference.path.is_file()]
        files = {model, *others, *(_make_plain_path(reference.path) for reference in existing)}
        for path in files:
            check_picture(path, search.size)
        root = common_folder(
            {*files, *(_make_plain_path(reference.place) for reference in existing)}
        )
        # The name of a package is not part of the scene: names start where the files do.
        inner = common_folder(files)
        digest = hashlib.sha256()
        for name in sorted(path.relative_to(inner) for path in files):
            data = (inner / name).read_bytes()
            digest.update(f"{name.as_posix()}\0{len(data)}\0".encode() + data)
        return SceneFiles(
            root=root,
            model=model.relative_to(root),
            files=tuple(sorted(path.relative_to(root) for path in files)),
            licences=tuple(
                sorted(path.relative_to(root) for path in _list_licence_files(files, root))
            ),
            resources={
                plain_name(reference.resource): _make_plain_path(reference.path)
                for reference in existing
                if reference.resource
            },
            copied=copy is not None,
            absolute=any(reference.absolute for reference in existing),
            hash=digest.hexdigest()[:16],
        )
    except OSError as error:
        raise SceneError(f"{error.filename or model}: {error.strerror}") from error
    except RecursionError as error:
        raise SceneError(f"{model}: its models include each other too deeply") from error


def _make_plain_path(path: Path) -> Path:
    """Return an absolute path without `..`; links stay, so that a copy keeps their names."""
    plain = Path(path.anchor)
    for part in path.absolute().parts:
        plain = plain.parent if part == ".." else plain / part
    return plain


def relative_path(path: Path, folder: Path) -> Path:
    """Return the path from a folder to the file of a path that starts here."""
    end, start = _make_plain_path(path), _make_plain_path(folder)
    shared = next(parent for parent in (start, *start.parents) if end.is_relative_to(parent))
    ascent = [".."] * (len(start.parts) - len(shared.parts))
    return Path(*ascent, end.relative_to(shared))


def common_folder(paths: Collection[Path]) -> Path:
    """Return the innermost folder that holds all of the paths."""
    first, *_ = paths
    return next(parent for parent in first.parents if all(parent in path.parents for path in paths))


_LICENCE = re.compile(r"(LICEN[SC]E|COPYING|NOTICE)\b.*", re.IGNORECASE)


def _list_licence_files(files: Iterable[Path], root: Path) -> Iterator[Path]:
    """Yield the licence files of the folders that hold files, up to the root."""
    folders = {folder for file in files for folder in file.parents if folder.is_relative_to(root)}
    for folder in folders:
        for path in folder.iterdir():
            if _LICENCE.fullmatch(path.name) and path.is_file() and not path.is_symlink():
                yield path
