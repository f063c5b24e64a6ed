"""Which files a model refers to, and where MuJoCo looks for them.

Rules from MuJoCo's XML reference (compiler, include, asset), tried on MuJoCo 3.17 and 4.0. MuJoCo
takes ROS resource names, `package://NAME/PATH` and `model://NAME/PATH`, for plain paths, which
never exist; here they are looked up.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from pathlib import Path

from contactlab.errors import SceneError

_ASSET_FOLDERS = {
    "mesh": "meshdir",
    "skin": "meshdir",
    "hfield": "meshdir",
    "texture": "texturedir",
    "flexcomp": "meshdir",
}
_FILE_KEYS = (
    "file",
    "filename",
    *(f"file{side}" for side in ("right", "left", "up", "down", "front", "back")),
)


def references(model: Path) -> Iterator[Path]:
    """Yield the files that an MJCF or URDF file refers to, existing or not.

    Raises:
        SceneError: the model, or a model that it includes or attaches, is missing or not XML.
    """
    return _references(model, set())


def _references(model: Path, seen: set[Path]) -> Iterator[Path]:
    elements = list(_elements(model, model.parent, seen))
    compiler: dict[str, str] = {}
    for element, path in elements:
        if element.tag == "compiler":
            compiler.update(element.attrib)
        if path != model:
            yield path
    for element, _ in elements:
        if element.tag == "model" and element.get("file"):
            attached = model.parent / element.get("file", "")
            yield attached
            yield from _references(attached, seen)
        elif element.tag in _ASSET_FOLDERS:
            yield from _assets(element, model.parent, compiler)


def _elements(path: Path, base: Path, seen: set[Path]) -> Iterator[tuple[ET.Element, Path]]:
    """Yield every element in document order, includes in their place, with its file."""
    if path.resolve() not in seen:
        seen.add(path.resolve())
        for element in parse(path).iter():
            yield element, path
            if element.tag == "include":
                name = element.get("file", "")
                beside = path.parent / name
                known = (base / name).is_file() or not beside.is_file()
                yield from _elements(base / name if known else beside, base, seen)


def _assets(element: ET.Element, base: Path, compiler: Mapping[str, str]) -> Iterator[Path]:
    folder = compiler.get(_ASSET_FOLDERS[element.tag], compiler.get("assetdir", ""))
    strip = compiler.get("strippath", "").lower() == "true"
    for key in _FILE_KEYS:
        if name := element.get(key):
            if is_resource(name) and not strip:
                yield find_resource(name, base)
            else:
                yield base / folder / (Path(name).name if strip else name)


def parse(path: Path) -> ET.Element:
    """Return the root element of an XML file.

    Raises:
        SceneError: it does not exist, or is not XML.
    """
    try:
        return ET.parse(path).getroot()  # noqa: S314 - a local model that the user asked to run
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file") from error
    except LookupError as error:
        raise SceneError(f"{path}: {error}; write the model in UTF-8") from error
    except ET.ParseError as error:
        line, column = error.position
        what = str(error).partition(":")[0]
        raise SceneError(f"{path}:{line}:{column + 1}: not XML: {what}") from error


_RESOURCE = re.compile(r"(?:package|model):/+([^/]+)/(.+)")


def is_resource(name: str) -> bool:
    """Return whether a file's name is a ROS resource name."""
    return _RESOURCE.fullmatch(name) is not None


def find_resource(name: str, folder: Path) -> Path:
    """Return the path of a ROS resource; where it is expected, if it does not exist.

    A package is a folder of that name that holds the model or lies next to a folder that does. So
    that copies of its files work too, any folder above the model may stand for the package.

    Args:
        name: `package://NAME/PATH`.
        folder: the model's folder.
    """
    places = list(_places(name, folder))
    return next((place for place in places if place.is_file()), places[0])


def _places(name: str, folder: Path) -> Iterator[Path]:
    resource = _RESOURCE.fullmatch(name)
    assert resource is not None
    package, rest = resource.groups()
    above = (folder, *folder.parents)
    named = next((each for each in above if each.name == package), None)
    if named is not None:
        yield named / rest
    for each in above:
        yield each / package / rest
        yield each / rest
