"""Which element of which file an object of a model comes from.

MuJoCo keeps the line of each element that it reads, through <attach>, <replicate>, frames and
classes, but not of what is included. Therefore files are laid out anew: what they include in its
place, each element on a line of its own, and no line of one file among those of another.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from contactlab.scene.model_files import FileSearch, parse
from contactlab.scene.model_text import elements_of, line_of

Origin = tuple[Path, int]  # a file, and the place of an element among all that it has


@dataclass(frozen=True)
class Origins:
    """Where elements come from."""

    search: FileSearch  # finds the files, in a copy of them
    # Of the elements on each line of what was laid out.
    by_line: dict[int, Origin] = field(default_factory=dict[int, Origin])
    # Of the main file's last element of each tag, in what was laid out.
    last: dict[str, Origin] = field(default_factory=dict[str, Origin])

    @classmethod
    def lay_out(cls, main: Path, copy: Path) -> "Origins":
        """Lay out a model of a copy, and the models that it attaches, over their files."""
        found = cls(FileSearch(copy))
        for root, path, origins in list(found._documents(main)):
            ET.indent(root)
            root.text = "\n" * (1 + max(found.by_line, default=0))
            ET.ElementTree(root).write(path)
            data = path.read_bytes()
            for element, text in zip(root.iter(), elements_of(data), strict=True):
                found.by_line[line_of(data, text.start)] = origins[element]
                if path == main:
                    found.last[element.tag] = origins[element]
        return found

    def _documents(
        self, path: Path
    ) -> Iterator[tuple[ET.Element, Path, Mapping[ET.Element, Origin]]]:
        origins: dict[ET.Element, Origin] = {}
        root = self._with_included(path, path.parent, origins)
        yield root, path, origins
        for model in root.iter("model"):
            if name := model.get("file"):
                yield from self._documents(self.search.named(path.parent, name).path)

    def _with_included(
        self, path: Path, base: Path, origins: dict[ET.Element, Origin]
    ) -> ET.Element:
        root = parse(path)
        origins |= {element: (path.resolve(), place) for place, element in enumerate(root.iter())}
        for parent in list(root.iter()):
            for place, child in reversed(list(enumerate(parent))):
                if child.tag == "include":
                    inner = self.search.included(child, path, base).path
                    parent[place : place + 1] = self._with_included(inner, base, origins)
        return root
