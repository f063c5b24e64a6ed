"""File rules: refusals and warnings of MuJoCo, and paths that other machines lack."""

import re
from collections.abc import Iterator
from pathlib import Path

import mujoco

from contactlab.scene.model_files import plain_name, relative_path
from contactlab.studies.lint.linted_model import Fault, LintedModel
from contactlab.studies.lint.rules import rule

_FILES = ("file", "filename")
_RESOURCE = re.compile(r"(package|model):/+")
_MEMORY = "memory, in bytes, if the default is too small"
# MuJoCo's XML reference calls these legacy attributes.
_LEGACY = {
    "size": dict.fromkeys(("njmax", "nconmax", "nstack"), _MEMORY),
    "light": {"directional": "type"},
}


@rule("unread", "gate", of_refused=True)
def find_unread_model(linted: LintedModel) -> Iterator[Fault]:
    """The model cannot be read or compiled, or names a file that it may not.

    The message is MuJoCo's, the line is the file's.
    """
    if linted.refused:
        # The first of several lines names the file; of one line, its beginning does.
        first, *lines = (line.strip() for line in linted.refused.splitlines())
        messages = [line for line in lines if line] or [
            first.removeprefix(f"{linted.source.model}: ")
        ]
        yield Fault("; ".join(messages), linted.refused_at)


@rule("deprecated", "warn", of_refused=True)
def find_engine_warnings(linted: LintedModel) -> Iterator[Fault]:
    """The installed MuJoCo warns of something as it compiles the model.

    Fix: as the message says.
    """
    for text in linted.warned:
        lines = (line.strip() for line in text.splitlines())
        # The place is that of the first element that the warning names by tag and attribute.
        words = set(re.findall(r"\w+", text))
        named = (
            linted.place_at(origin)
            for element, origin in linted.tags
            if element.tag in words and words & element.attrib.keys()
        )
        yield Fault("; ".join(line for line in lines if line), next(named, None))


@rule("legacy", "note", of_refused=True)
def find_legacy_attributes(linted: LintedModel) -> Iterator[Fault]:
    """An attribute is one that MuJoCo keeps for old files only.

    `njmax`, `nconmax`, `nstack`, `directional`. Fix: leave it out.
    """
    for element, origin in linted.tags:
        for name, instead in _LEGACY.get(element.tag, {}).items():
            if name in element.attrib:
                message = f"{name} of <{element.tag}> is for old files only; write {instead}"
                yield Fault(message, linted.place_at(origin))


@rule("absolute-path", "warn", of_refused=True)
def find_absolute_paths(linted: LintedModel) -> Iterator[Fault]:
    """A file or a folder is named by a path that starts at the root of one machine.

    Fix: the path relative to the model.
    """
    for element, origin in linted.tags:
        for key in (*_FILES, "meshdir", "texturedir", "assetdir"):
            path = Path(element.get(key, ""))
            if path.is_absolute():
                nearer = relative_path(path, linted.main.parent).as_posix()
                message = f"<{element.tag}> names {path}, which other machines lack"
                yield Fault(message, linted.place_at(origin), linted.set_at(origin, {key: nearer}))


@rule("resource-name", "gate", of_refused=True)
def find_unresolved_resources(linted: LintedModel) -> Iterator[Fault]:
    """A file is named by its ROS package, and MuJoCo alone does not find it.

    Its package is sought next to the model. Fix: the path in the message, with
    `<mujoco><compiler strippath="false"/></mujoco>`.
    """
    named = [
        (element.get(key, ""), origin)
        for element, origin in linted.tags
        for key in _FILES
        if _RESOURCE.match(element.get(key, ""))
    ]
    if not named:
        return
    try:
        mujoco.MjSpec.from_file(str(linted.main)).compile()
    except (ValueError, mujoco.FatalError) as error:
        refused = str(error).strip().splitlines()[0]
    else:
        return
    if "opening file" not in refused:
        return
    (name, origin), *others = named
    more = f", nor {len(others)} more of such names" if others else ""
    paths = linted.source.content.resources
    there = paths.get(plain_name(name))
    hint = "no folder next to the model has it"
    if there is not None:
        hint = f"it is {relative_path(there, linted.main.parent).as_posix()}"
    message = f"MuJoCo does not find {name}{more} ({refused}); {hint}"
    yield Fault(message, linted.place_at(origin))


@rule("unused-asset", "note")
def find_unused_assets(linted: LintedModel) -> Iterator[Fault]:
    """A file is read for a mesh or a height field that no geom has.

    Fix: remove it.
    """
    model, spec = linted.model, linted.spec
    if not model.nmesh + model.nhfield:
        return
    used = {name for geom in spec.geoms for name in (geom.meshname, geom.hfieldname)}
    skinned = bool(model.nskin or model.nflex or model.nplugin or model.nsensor)
    for kind, assets in (("mesh", spec.meshes), ("hfield", spec.hfields)):
        unused = [asset.name for asset in assets if asset.file and asset.name not in used]
        if unused and not skinned:
            more = f", and {len(unused) - 1} more" if len(unused) > 1 else ""
            message = f"{kind} '{unused[0]}' is read, and no geom has it{more}"
            yield Fault(message, linted.place(kind, unused[0]))
