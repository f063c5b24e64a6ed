"""A model from its files and compiled, with the line of each part."""

import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import mujoco

from contactlab.errors import SceneError, explain_fatal
from contactlab.resources import limited_memory
from contactlab.scene.body_inertia import inertia_faults
from contactlab.scene.compile_model import (
    COMPILE_BYTES,
    COMPILE_ERRORS,
    InertiaFault,
    check_numbers,
    compile_error,
    parse_spec,
    written_inertia_faults,
)
from contactlab.scene.model_names import OBJECT_LISTS, name_of
from contactlab.scene.model_text import (
    ElementText,
    Origin,
    Origins,
    Replacement,
    append_lines,
    apply_replacements,
    elements_of,
    line_of,
    with_attributes,
)
from contactlab.scene.model_xml import Elements, list_elements, parse_model
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.scene.scene_source import MODEL_SUFFIXES, SceneSource
from contactlab.scene.task import keyframe_names
from contactlab.schema.task import QPOS0
from contactlab.temporary_folders import temporary_folder

_KINDS = {
    **OBJECT_LISTS,
    "mesh": "meshes",
    "hfield": "hfields",
    "texture": "textures",
    "site": "sites",
}
_UNLINED = "key"  # MuJoCo keeps no lines of keyframes
_ATTACHING = {"attach", "replicate"}
_LINE = re.compile(r":(\d+): does not compile")
_LINKS = {"body": "link", "joint": "joint"}  # names in URDF


class Place(NamedTuple):
    """Start tag of an element in a file: its first and last line."""

    file: Path
    line: int
    last: int


class ShortKeyframe(NamedTuple):
    """A keyframe with a wrong count of numbers.

    Attributes:
        attribute: such as `qpos`.
        length: count of its numbers.
        needed: count of the model's.
        place: of its element.
    """

    attribute: str
    length: int
    needed: int
    place: Place


class Edit(NamedTuple):
    """A change of a file."""

    place: Place
    text: str  # the changed element
    replacement: Replacement

    def __str__(self) -> str:
        return f"{shown_path(self.place.file)}:{self.place.line}: {self.text}"


class Fault(NamedTuple):
    """A broken rule; without a place, it is reported in the first line of the main file."""

    message: str
    place: Place | None = None
    edits: tuple[Edit, ...] = ()


def shown_path(path: Path) -> str:
    """Return a path for reports: relative to the working directory if it is below it."""
    here = Path.cwd()
    return (path.relative_to(here) if path.is_relative_to(here) else path).as_posix()


@dataclass(frozen=True)
class LintedModel:
    """A scene's model, compiled from its files.

    Attributes:
        source: the scene.
        spec: specification from its files. A rule must not change it.
        warned: warnings of MuJoCo.
        refused: why MuJoCo does not compile it, or "".
        inertia: faults of the written inertias.
    """

    source: SceneSource
    spec: mujoco.MjSpec
    compiled: mujoco.MjModel | None
    warned: tuple[str, ...]
    refused: str
    refused_at: Place | None
    inertia: tuple[InertiaFault, ...]
    _origins: Mapping[
        tuple[str, str], Origin
    ]  # of parts, by kind and name, in the scene's own files
    _last: Mapping[str, Origin]  # of the last element of each tag

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model; it must compile."""
        assert self.compiled is not None
        return self.compiled

    @property
    def main(self) -> Path:
        """The main file."""
        return self.source.model

    @cached_property
    def is_urdf(self) -> bool:
        """Whether the main file is a URDF."""
        return self._file_roots[self.main].tag == "robot"

    @cached_property
    def starts(self) -> Mapping[str, mujoco.MjData]:
        """State of each start after `mj_forward`, by name: keyframes, or `QPOS0` without any.

        Keyframes with a wrong count of numbers are mistakes, and left out.
        """
        silence_mujoco()
        data_by_start = dict[str, mujoco.MjData]()
        names = [name for name in keyframe_names(self.model) if name not in self.short_keyframes]
        for name in names or (QPOS0,):
            data = mujoco.MjData(self.model)
            if name != QPOS0:
                mujoco.mj_resetDataKeyframe(self.model, data, self.model.key(name).id)
            try:
                mujoco.mj_forward(self.model, data)
            except mujoco.FatalError as error:
                why = explain_fatal(error)
                raise SceneError(f"MuJoCo cannot compute the state {name}: {why}") from error
            data_by_start[name] = data
        return data_by_start

    @cached_property
    def short_keyframes(self) -> Mapping[str, ShortKeyframe]:
        """Keyframes with a wrong count of numbers, by name.

        MuJoCo completes those of attached models, so these are not judged.
        """
        if self.is_urdf or any(element.tag in _ATTACHING for element, _ in self.tags):
            return {}
        model = self.model
        sizes = {
            "qpos": model.nq,
            "qvel": model.nv,
            "act": model.na,
            "ctrl": model.nu,
            "mpos": 3 * model.nmocap,
            "mquat": 4 * model.nmocap,
        }
        keyframes = dict[str, ShortKeyframe]()
        for element, origin in self.tags:
            if element.tag != _UNLINED:
                continue
            for attribute, size in sizes.items():
                text = element.get(attribute)
                if text is not None and (count := len(text.split())) != size:
                    place = self.place_at(origin)
                    short = ShortKeyframe(attribute, count, size, place)
                    keyframes.setdefault(element.get("name", ""), short)
        return keyframes

    @cached_property
    def reference(self) -> mujoco.MjData:
        """State of the reference pose after `mj_forward`."""
        if QPOS0 in self.starts:
            return self.starts[QPOS0]
        data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, data)
        return data

    @cached_property
    def inertia_faults(self) -> tuple[InertiaFault, ...]:
        """Faults of inertias, as written and as compiled, each once."""
        compiled = () if self.compiled is None else inertia_faults(self.compiled)
        all_faults = (*self.inertia, *compiled)
        return tuple({(fault.body, fault.kind): fault for fault in all_faults}.values())

    def name(self, kind: str, index: int) -> str:
        """Return the name or the address of a part of the compiled model."""
        return name_of(self.model, kind, index)

    def place(self, kind: str, name: str | int) -> Place:
        """Return the line of a part's element, or the first of the main file."""
        return self.place_at(self._find_origin(kind, name))

    def place_of(self, tag: str) -> Place:
        """Return the line of the last element of a tag, or the first of the main file."""
        return self.place_at(self._last.get(tag))

    def set(self, kind: str, name: str | int, /, **values: str) -> tuple[Edit, ...]:
        """Return the edit that sets attributes of a part's element, if it has one."""
        return self.set_at(self._find_origin(kind, name), values)

    def set_in(self, tag: str, /, **values: str) -> tuple[Edit, ...]:
        """Return the edit that sets attributes in the last element of a tag, or adds one."""
        return self.set_at(self._last.get(tag), values) or self.add(ET.Element(tag, values))

    def add(self, element: ET.Element) -> tuple[Edit, ...]:
        """Return the edit that adds an element at the end of MJCF's main file."""
        if self.is_urdf:
            return ()
        data, (root, *_) = self._file_texts[self.main], self._elements[self.main]
        line = ET.tostring(element, encoding="unicode").replace(" />", "/>")
        if b"</" not in data[root.inner : root.end]:
            return ()
        replacement = append_lines(data, root, [line])
        number = line_of(data, replacement.start)
        return (Edit(Place(self.main, number, number), line, replacement),)

    @cached_property
    def _file_texts(self) -> Mapping[Path, bytes]:
        root = self.source.content.root
        files = [root / file for file in self.source.content.files]
        return {file: file.read_bytes() for file in files if file.suffix in MODEL_SUFFIXES}

    @cached_property
    def _file_roots(self) -> Mapping[Path, ET.Element]:
        return {file: parse_model(file) for file in self._file_texts}

    @cached_property
    def _elements(self) -> Mapping[Path, list[ElementText]]:
        return {file: elements_of(text) for file, text in self._file_texts.items()}

    def _find_origin(self, kind: str, name: str | int) -> Origin | None:
        element_name = self.name(kind, name) if isinstance(name, int) else name
        return self._origins.get((kind, element_name))

    def place_at(self, origin: Origin | None) -> Place:
        """Return the line of an element, or the first of the main file."""
        file, number = origin or (self.main, 0)
        data, element = self._file_texts[file], self._elements[file][number]
        return Place(file, line_of(data, element.start), line_of(data, element.inner - 1))

    def set_at(self, origin: Origin | None, values: Mapping[str, str]) -> tuple[Edit, ...]:
        """Return the edit that sets attributes of an MJCF element, if there is one."""
        if origin is None or self.is_urdf:
            return ()
        file, element = origin
        change = with_attributes(self._file_texts[file], self._elements[file][element], values)
        text = " ".join(change.text.decode(errors="replace").split())
        return (Edit(self.place_at(origin), text, change),)

    @cached_property
    def elements(self) -> Elements:
        """Elements of all model files, with their paths and attributes."""
        return [element for root in self._file_roots.values() for element in list_elements(root)]

    @cached_property
    def tags(self) -> Sequence[tuple[ET.Element, Origin]]:
        """Every element of the scene's files as written, with its origin."""
        return [
            (element, (file, place))
            for file, root in self._file_roots.items()
            for place, element in enumerate(root.iter())
        ]


def apply_edits(faults: Iterator[Fault]) -> Mapping[Path, bytes]:
    """Return the files that the edits of faults change, with the edits."""
    changes: dict[Path, set[Replacement]] = {}
    for fault in faults:
        for edit in fault.edits:
            changes.setdefault(edit.place.file, set()).add(edit.replacement)
    return {
        file: apply_replacements(file.read_bytes(), replacements)
        for file, replacements in changes.items()
    }


@contextmanager
def linted_model(source: SceneSource) -> Generator[LintedModel]:
    """Yield a scene's model; its copied files exist within the context."""
    with _laid_out(source) as (copy, origins):
        silence_mujoco()
        lines: dict[tuple[str, str], int] = {}
        refused, model, faults = "", None, tuple[InertiaFault, ...]()
        spec = mujoco.MjSpec()
        with warnings.catch_warnings(record=True) as caught, limited_memory(COMPILE_BYTES):
            warnings.simplefilter("always")
            try:
                spec = parse_spec(copy, copy.model)
                for kind, plural in _KINDS.items():
                    parts: list[Any] = list(getattr(spec, plural))
                    for part in parts:
                        lines[kind, part.name] = int(part.info.rpartition(" ")[2] or 0)
                faults = tuple(written_inertia_faults(spec))
                compiled = spec.compile()
                check_numbers(compiled, copy.model)
                model = compiled
            except (SceneError, *COMPILE_ERRORS) as error:
                resource = isinstance(error, SceneError)
                error_message = str(
                    error if resource else compile_error(copy.model, copy.model, error)
                )
                refused = error_message.replace(str(copy.content.root), str(source.content.root))
        own, by_line = source.content.root, origins.by_line
        texts = (str(warning.message) for warning in caught)
        warned = tuple(
            dict.fromkeys(text.replace(str(copy.content.root), str(own)) for text in texts)
        )

        def real(origin: Origin) -> Origin:
            return own / origin[0].relative_to(copy.content.root), origin[1]

        found_at = {part: real(by_line[line]) for part, line in lines.items() if line in by_line}
        unlined = (part for part, line in lines.items() if part[0] == _UNLINED and not line)
        found_at |= dict(zip(unlined, map(real, origins.keyframes), strict=False))
        linted = LintedModel(
            source=source,
            spec=spec,
            compiled=model,
            warned=warned,
            refused=refused,
            refused_at=None,
            inertia=faults,
            _origins=found_at or dict(_urdf_lines(source.model)),
            _last={tag: real(origin) for tag, origin in origins.last.items()},
        )
        line = _LINE.search(refused)
        if line is not None and (origin := by_line.get(int(line[1]))) is not None:
            place = linted.place_at(real(origin))
            refusal = refused.replace(line[0], f":{place.line}: does not compile")
            linted = replace(linted, refused=refusal, refused_at=place)
        yield linted


@contextmanager
def _laid_out(source: SceneSource) -> Generator[tuple[SceneSource, Origins]]:
    """Yield a copy of a scene with one line per element, and links to other files."""
    content = source.content
    with temporary_folder() as folder:
        # below folders of the same names, since paths may go up
        root = Path(folder).resolve() / content.root.relative_to(content.root.anchor)
        for file in content.files:
            target = root / file
            target.parent.mkdir(parents=True, exist_ok=True)
            if file.suffix in MODEL_SUFFIXES:
                target.write_bytes((content.root / file).read_bytes())
            else:
                target.symlink_to((content.root / file).resolve())
        copied = replace(
            content,
            root=root,
            resources={
                name: root / path.relative_to(content.root)
                for name, path in content.resources.items()
            },
        )
        copy = replace(source, content=copied)
        yield copy, Origins.lay_out(copy.model, root)


def _urdf_lines(urdf: Path) -> Iterator[tuple[tuple[str, str], Origin]]:
    """Yield the links and joints of a URDF; MuJoCo keeps no lines for them."""
    for place, element in enumerate(parse_model(urdf).iter()):
        for kind, tag in _LINKS.items():
            if element.tag == tag and (name := element.get("name")):
                yield (kind, name), (urdf, place)
