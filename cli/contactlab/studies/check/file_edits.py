"""Changes of a model's file, each tried by compiling a copy of the model with it."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco

from contactlab.errors import SceneError
from contactlab.mjcf import CONTACT, OPTIONS, attributes, default_lines, option_lines
from contactlab.scene.compile_model import compile_model
from contactlab.scene.contact_pairs import effective_parameters
from contactlab.scene.scene_source import SceneSource
from contactlab.schema.check_report import Edit
from contactlab.studies.check.check_results import mjcf_text
from contactlab.studies.check.checked_model import CheckedModel
from contactlab.studies.session import Values

_START = re.compile(r"<mujoco\b[^>]*[^/]>|<mujoco>")
_MOST_NAMED = 12


def edits_of(checked: CheckedModel, settings: Values) -> tuple[Edit, ...]:
    """Return the changes of a model's file that make settings, options before contact parameters.

    Lines are given only where a copy of the model with them compiles to the checked model, which
    has the settings; else the elements to change are named.
    """
    texts = {name: mjcf_text(value) for name, value in settings.items()}
    edits = [
        *_option_edits(checked, {name: texts[name] for name in OPTIONS if name in texts}),
        *_contact_edits(checked, {name: texts[name] for name in CONTACT if name in texts}),
    ]
    return tuple(edits)


def _option_edits(checked: CheckedModel, options: Mapping[str, str]) -> Iterator[Edit]:
    if not options:
        return
    edit = Edit(where="before </mujoco>", lines=tuple(option_lines(options, {})))
    model, expected = _compiled(checked.scene.source, edit), checked.prepared.model.opt
    if model and all(_equal(getattr(model.opt, each), getattr(expected, each)) for each in options):
        yield edit
    else:
        yield Edit(where="in the <option> element", lines=(attributes(options).strip(),))


def _contact_edits(checked: CheckedModel, contact: Mapping[str, str]) -> Iterator[Edit]:
    if not contact:
        return
    elements = ("geom", "pair") if checked.base.targets.explicit else ("geom",)
    lines = tuple(default_lines(contact, elements))
    for where in ("right after <mujoco>", "before </mujoco>"):
        edit = Edit(where=where, lines=lines)
        model = _compiled(checked.scene.source, edit)
        if model and _reaches(checked, model, contact):
            yield edit
            return
    yield Edit(where=_elements(checked), lines=(attributes(contact).strip(),))


def _elements(checked: CheckedModel) -> str:
    model, targets = checked.base.model, checked.base.targets
    geoms = [f"'{model.geom(each).name}'" for each in targets.geoms]
    named = ", ".join(geoms[:_MOST_NAMED])
    more = f" and {len(geoms) - _MOST_NAMED} more" if len(geoms) > _MOST_NAMED else ""
    pairs = f"the {len(targets.explicit)} <pair> elements" if targets.explicit else ""
    of_geoms = f"each of the geoms {named}{more}" if geoms else ""
    return "in " + " and ".join(filter(None, [of_geoms, pairs]))


def _reaches(checked: CheckedModel, model: mujoco.MjModel, names: Iterable[str]) -> bool:
    """Say whether a compiled model gives every monitored pair the parameters that were run."""
    wanted = checked.prepared.pairs
    found = {pair.name: effective_parameters(model, pair) for pair in checked.base.pairs}
    return all(
        _equal(getattr(found[pair], name), getattr(wanted[pair], name))
        for pair in wanted
        for name in names
    )


def _equal(some: object, other: object) -> bool:
    return mjcf_text(some) == mjcf_text(other)


def _compiled(source: SceneSource, edit: Edit) -> mujoco.MjModel | None:
    """Return a copy of the model with lines added; None if it does not compile, or is no MJCF."""
    text = source.model.read_text(encoding="utf-8")
    start, end = _START.search(text), text.rfind("</mujoco>")
    if start is None or end < 0 or source.model.suffix == ".urdf":
        return None
    place = start.end() if edit.where.startswith("right") else end
    with TemporaryDirectory(prefix="contactlab-") as folder:
        source.content.copy_to(Path(folder))
        copied = replace(source, content=replace(source.content, root=Path(folder)))
        added = "\n".join(["", *edit.lines, ""])
        copied.model.write_text(text[:place] + added + text[place:], encoding="utf-8")
        try:
            return compile_model(copied, {}, lambda _: None)
        except SceneError:
            return None
