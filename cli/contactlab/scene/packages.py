"""Where ROS resource names point: `package://NAME/PATH` and `model://NAME/PATH`.

MuJoCo takes them for plain paths, which never exist.
"""

import re
from collections.abc import Iterator
from pathlib import Path

_RESOURCE = re.compile(r"(?:package|model):/+([^/]+)/(.+)")


def is_resource(name: str) -> bool:
    """Say whether a file's name is that of a resource of a package."""
    return _RESOURCE.fullmatch(name) is not None


def find_resource(name: str, folder: Path) -> Path:
    """Return the file of a resource's name; where it should be, if it is not there.

    A package is a folder of that name, in or above the model's folder. So that a copy of the files
    alone is found as well, any folder above the model may stand for the package.

    Args:
        name: `package://NAME/PATH`.
        folder: the model's.
    """
    places = list(_places(name, folder))
    return next((place for place in places if place.is_file()), places[0])


def _places(name: str, folder: Path) -> Iterator[Path]:
    found = _RESOURCE.fullmatch(name)
    assert found is not None
    package, rest = found.groups()
    above = (folder, *folder.parents)
    named = next((each for each in above if each.name == package), None)
    if named is not None:
        yield named / rest
    for each in above:
        yield each / package / rest
        yield each / rest
