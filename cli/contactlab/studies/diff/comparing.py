"""Compares two models: what parts both have, their quantities, and how they move."""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from contactlab.mjcf import OPTIONS
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.contact_pairs import may_touch, reaches
from contactlab.scene.model_edits import FLAGS, read_flag, read_option
from contactlab.scene.model_names import KINDS, name_of
from contactlab.scene.mujoco_versions import VERSION
from contactlab.scene.scene import Scene
from contactlab.schema.diff_report import Difference, DiffReport
from contactlab.store.finished_store import Store
from contactlab.studies.diff.matching import Matched, matched
from contactlab.studies.diff.motion_change import motion_change
from contactlab.studies.diff.quantities import QUANTITIES, Quantity, changed_by, text
from contactlab.writers.report import Report, Section

WITHIN = 1e-4
"""Share up to which quantities are alike: MuJoCo writes models with six digits."""
_LEAST_LENGTH = 1e-3  # of a part whose size is not known, over the model's extent
_FIRST: dict[str, str] = {
    "body": "mass",
    "joint": "type",
    "geom": "type",
    "actuator": "transmission",
}


def diff(before: str, after: str, within: float = WITHIN) -> DiffReport:
    """Compare two models, or the scenes of stores.

    A SceneError says that there is no such model, or why it does not compile.
    """
    scenes = [scene_of(reference) for reference in (before, after)]
    one, other = (scene.base({}).model for scene in scenes)
    found = matched(one, other)
    motion, unmoved = motion_change(scenes[0], one, other, found)
    return DiffReport(
        mujoco=VERSION,
        before=before,
        after=after,
        within=within,
        matched={kind: len(both) for kind, both in found.both.items()},
        differences=tuple(differences(one, other, within, found)),
        motion=motion,
        unmoved=unmoved,
    )


def scene_of(reference: str) -> Scene:
    """Return the scene that a reference names, or that a store has."""
    folder = Path(reference).expanduser()
    if (folder / "manifest.json").is_file():
        store = Store.open(folder)
        return stored_sweep_scene(store.manifest.sweep, store.scene_folder)
    return SceneLoader(Path()).open(reference).with_effects("all")


def differences(
    one: mujoco.MjModel, other: mujoco.MjModel, within: float = WITHIN, found: Matched | None = None
) -> Iterator[Difference]:
    """Yield what two compiled models do not have alike, beyond a share."""
    found = found or matched(one, other)
    yield from _of_model(one, other, within)
    for kind, listed in QUANTITIES.items():
        for before, after in found.both[kind]:
            if kind == "geom" and not (_collides(one, before) or _collides(other, after)):
                continue
            yield from _of_part((one, other), kind, (before, after), listed, within)
        for model, ids, is_new in ((one, found.gone, False), (other, found.new, True)):
            for index in ids[kind]:
                if kind != "geom" or _collides(model, index):
                    yield _alone(model, kind, index, is_new=is_new)
    yield from _of_sets("exclude", _excludes(one), _excludes(other))
    yield from _of_sets("filter", *_filters(one, other, found))


def _of_model(one: mujoco.MjModel, other: mujoco.MjModel, within: float) -> Iterator[Difference]:
    """Yield differences of options and flags."""
    for name in OPTIONS:
        before, after = read_option(one, name), read_option(other, name)
        share = changed_by("value", before, after, 1.0)
        if share is None or share > within:
            told = text(before), text(after)
            yield Difference(
                kind="option", name="", quantity=name, before=told[0], after=told[1], share=share
            )
    for name in FLAGS:
        before, after = read_flag(one, name), read_flag(other, name)
        if before != after:
            words = ["enable" if state else "disable" for state in (before, after)]
            yield Difference(
                kind="flag", name="", quantity=name, before=words[0], after=words[1], share=None
            )


def _of_part(
    models: tuple[mujoco.MjModel, mujoco.MjModel],
    kind: str,
    ids: tuple[int, int],
    listed: tuple[Quantity, ...],
    within: float,
) -> Iterator[Difference]:
    length = _length(models[0], kind, ids[0])
    for quantity in listed:
        before, after = (
            quantity.read(model, index) for model, index in zip(models, ids, strict=True)
        )
        share = changed_by(quantity.measured, before, after, length)
        if share is None or share > within:
            yield Difference(
                kind=kind,
                name=name_of(models[0], kind, ids[0]),
                quantity=quantity.name,
                before=text(before),
                after=text(after),
                unit=quantity.unit,
                share=share,
            )


def _length(model: mujoco.MjModel, kind: str, index: int) -> float:
    """Return the length that places of a part are compared with [m]: its body's reach."""
    owners = {"body": None, "joint": model.jnt_bodyid, "geom": model.geom_bodyid}
    least = _LEAST_LENGTH * float(model.stat.extent)
    if kind not in owners:
        return least
    owner = owners[kind]
    body = index if owner is None else int(owner[index])
    inside = reaches(model)[body]
    away = float(np.linalg.norm(model.body_pos[body]))
    return float(max(least, inside, away))


def _alone(model: mujoco.MjModel, kind: str, index: int, *, is_new: bool) -> Difference:
    """Return the difference of a part that one model has alone."""
    first = _FIRST.get(kind)
    quantity = next((one for one in QUANTITIES[kind] if one.name == first), QUANTITIES[kind][0])
    told = text(quantity.read(model, index))
    return Difference(
        kind=kind,
        name=name_of(model, kind, index),
        quantity=quantity.name,
        before="" if is_new else told,
        after=told if is_new else "",
        unit=quantity.unit,
        share=None,
    )


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    listed = np.isin(geom, [model.pair_geom1, model.pair_geom2])
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom] or listed)


def _excludes(model: mujoco.MjModel) -> set[str]:
    pairs = (divmod(int(signature), 1 << 16) for signature in model.exclude_signature)
    return {" - ".join(sorted(name_of(model, "body", body) for body in pair)) for pair in pairs}


def _filters(
    one: mujoco.MjModel, other: mujoco.MjModel, found: Matched
) -> tuple[set[str], set[str]]:
    """Return the pairs of bodies that can touch, in the first model's names, of those in both."""
    names = {after: name_of(one, "body", before) for before, after in found.both["body"]}
    own = {before: name_of(one, "body", before) for before, _ in found.both["body"]}
    return _touching(one, own), _touching(other, names)


def _touching(model: mujoco.MjModel, names: dict[int, str]) -> set[str]:
    bodies = np.asarray(model.geom_bodyid)
    pairs = {tuple(bodies[[*pair]].tolist()) for pair in np.argwhere(may_touch(model)).tolist()}
    return {
        " - ".join(sorted((names[first], names[second])))
        for first, second in pairs
        if first in names and second in names
    }


def _of_sets(kind: str, before: set[str], after: set[str]) -> Iterator[Difference]:
    """Yield pairs of bodies that one model has alone."""
    words = {"exclude": ("listed", ""), "filter": ("can touch", "cannot touch")}[kind]
    for name in sorted(before ^ after):
        told = words if name in before else words[::-1]
        yield Difference(
            kind=kind, name=name, quantity="bodies", before=told[0], after=told[1], share=None
        )


def report_of(report: DiffReport) -> Report:
    """Return what is written of a report."""
    rows = tuple(
        (
            found.kind,
            found.name,
            found.quantity,
            found.before or "none",
            found.after or "none",
            found.unit,
            "" if found.share is None else f"{100 * found.share:.3g} %",
        )
        for found in report.differences
    )
    header = ("kind", "name", "quantity", "before", "after", "unit", "change")
    parts = ", ".join(
        f"{count} {KINDS[kind] if count > 1 else kind}"
        for kind, count in report.matched.items()
        if count
    )
    return Report(
        title=f"contactlab diff {report.before} {report.after}",
        place=("diff",),
        headline=report.headline,
        passed=not report.differences,
        record=report,
        facts=(
            ("before", report.before),
            ("after", report.after),
            ("engine", f"mujoco {report.mujoco}"),
            ("in both", parts),
        ),
        sections=(Section("", header=header, rows=rows),) if rows else (),
        notes=(report.last_line,),
    )
