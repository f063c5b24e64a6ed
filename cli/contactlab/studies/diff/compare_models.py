"""Compares two models: their shared parts, the quantities of these, and their motion."""

from collections.abc import Collection, Iterator
from pathlib import Path

import mujoco
import numpy as np

from contactlab.errors import ContactlabError
from contactlab.mjcf import OPTIONS
from contactlab.rendering.amounts import format_amount
from contactlab.rendering.document import (
    Document,
    Facts,
    Headline,
    Sentence,
    document_of,
    table_of,
)
from contactlab.run.planned_runs import open_store_scene
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.contact_pairs import body_reaches, touch_mask
from contactlab.scene.model_edits import FLAG_NAMES, read_flag, read_option
from contactlab.scene.model_names import OBJECT_LISTS, name_of
from contactlab.scene.mujoco_versions import VERSION
from contactlab.scene.scene import Scene
from contactlab.schema.diff_report import Difference, DiffReport
from contactlab.step_progress import step_names
from contactlab.store.finished_store import Store
from contactlab.studies.diff.matching import MatchedParts, match_parts
from contactlab.studies.diff.motion_change import motion_change
from contactlab.studies.diff.quantities import QUANTITIES, Quantity, format_value, relative_change
from contactlab.writers.signs import outcome_mark

DEFAULT_TOLERANCE = 1e-4
"""Quantities are equal up to this relative change: MuJoCo writes models with six digits."""
_MAIN_QUANTITY: dict[str, str] = {
    "body": "mass",
    "joint": "type",
    "geom": "type",
    "actuator": "transmission",
}


def diff_models(before: str, after: str, tolerance: float = DEFAULT_TOLERANCE) -> DiffReport:
    """Compare two models, or the scenes of stores.

    A SceneError says that there is no such model, or why it does not compile.
    """
    with step_names(2) as begin_step:
        begin_step("reading the models")
        scenes = [find_model_scene(reference) for reference in (before, after)]
        one, other = (scene.base({}).model for scene in scenes)
        matched_parts = match_parts(one, other)
        begin_step("comparing their motion")
        motion, no_motion_reason = motion_change(scenes[0], one, other, matched_parts)
    return DiffReport(
        mujoco=VERSION,
        before=before,
        after=after,
        tolerance=tolerance,
        matched={kind: len(both) for kind, both in matched_parts.both.items()},
        differences=tuple(find_differences(one, other, tolerance, matched_parts)),
        motion=motion,
        no_motion_reason=no_motion_reason,
    )


def find_model_scene(reference: str) -> Scene:
    """Return the scene that a reference names, or that a store has."""
    folder = Path(reference).expanduser()
    if (folder / "manifest.json").is_file():
        store = Store.open(folder)
        return open_store_scene(store)
    return SceneLoader(Path()).open(reference).with_effects("all")


def summarize_changes(before: str, after: str) -> tuple[list[str], set[str]]:
    """Return the differences of the models of two stores in words, and the changed quantities.

    Alike differences are together. A model that cannot be compared here, as one of another version,
    is named with the reason.
    """
    try:
        one, other = (find_model_scene(each).base({}).model for each in (before, after))
    except ContactlabError as error:
        return [f"the model; it cannot be compared here: {error}"], set()
    alike = dict[tuple[str, ...], list[Difference]]()
    matched_parts = match_parts(one, other)
    for changes in find_differences(one, other, matched_parts=matched_parts):
        factor = _common_factor(changes.before, changes.after)
        change = (factor,) if factor else (changes.before, changes.after)
        if not all(change):
            change = ("gone" if changes.before else "new",)
        alike.setdefault((changes.kind, changes.quantity, changes.unit, *change), []).append(
            changes
        )
    sentences = list[str]()
    for (kind, quantity, _, *change), changes in alike.items():
        parts = f"{len(changes)} {OBJECT_LISTS.get(kind, f'{kind}s')}"
        in_contact = ""
        if (kind, quantity) == ("geom", "friction") and changes[0].before and changes[0].after:
            geoms = {each.name for each in changes}
            in_contact = _describe_contact_friction(one, other, matched_parts, geoms)
        if len(changes) == 1:
            sentences.append(changes[0].sentence + in_contact)
        elif not (changes[0].before and changes[0].after):
            names = ", ".join(each.name for each in changes[:3]) + ", ..." * (len(changes) > 3)
            sentences.append(f"{parts} are {change[0]}: {names}")
        elif len({(each.before, each.after) for each in changes}) == 1:
            shared_change = changes[0].model_copy(update={"kind": parts, "name": ""})
            sentences.append(shared_change.sentence + in_contact)
        else:
            sentences.append(f"{parts}: {quantity} x{change[0]}{in_contact}")
    return sentences, {quantity for _, quantity, *_ in alike}


def _describe_contact_friction(
    one: mujoco.MjModel, other: mujoco.MjModel, matched_parts: MatchedParts, names: Collection[str]
) -> str:
    # Empty if it changes as the friction of these geoms does. A contact has the larger friction of
    # its two geoms, or that of the higher priority. A <pair> element has a friction of its own.
    matches = np.array(matched_parts.both["geom"]).reshape(-1, 2)
    rows = [row for row, (geom, _) in enumerate(matches) if name_of(one, "geom", geom) in names]
    touch = touch_mask(one, listed=False)[np.ix_(matches[rows, 0], matches[:, 0])]
    touch &= touch_mask(other, listed=False)[np.ix_(matches[rows, 1], matches[:, 1])]
    if not touch.any():
        return ""
    before, after = (
        _contact_frictions(model, geoms[rows], geoms)[touch]
        for model, geoms in ((one, matches[:, 0]), (other, matches[:, 1]))
    )
    if np.array_equal(before, after):
        return f"; {_SLIDING}: {_format_range(before)}, as before, by the other geom"
    own = [
        np.broadcast_to(model.geom_friction[geoms, :1], touch.shape)[touch]
        for model, geoms in ((one, matches[rows, 0]), (other, matches[rows, 1]))
    ]
    if np.array_equal(before, own[0]) and np.array_equal(after, own[1]):
        return ""
    return f"; {_SLIDING}: {_format_range(before)} -> {_format_range(after)}"


_SLIDING = "sliding friction in contact"


def _contact_frictions(model: mujoco.MjModel, geoms: np.ndarray, others: np.ndarray) -> np.ndarray:
    own, their = model.geom_friction[geoms, :1], model.geom_friction[others, 0]
    rank, other_rank = model.geom_priority[geoms, None], model.geom_priority[others]
    by_priority = np.where(rank > other_rank, own, their)
    return np.where(rank == other_rank, np.maximum(own, their), by_priority)


def _format_range(values: np.ndarray) -> str:
    low, high = f"{values.min():.4g}", f"{values.max():.4g}"
    return low if low == high else f"{low} to {high}"


def _common_factor(before: str, after: str) -> str:
    # Empty if the ratios of their numbers differ.
    try:
        one, other = (np.array(text.split(), dtype=float) for text in (before, after))
    except ValueError:
        return ""
    is_nonzero = one != 0
    if one.shape != other.shape or not is_nonzero.any() or other[~is_nonzero].any():
        return ""
    ratios = other[is_nonzero] / one[is_nonzero]
    rounding = 1e-4  # of numbers that are printed with six digits
    if np.ptp(ratios) > rounding * abs(ratios).max():
        return ""
    return f"{np.median(ratios):.4g}"


def find_differences(
    one: mujoco.MjModel,
    other: mujoco.MjModel,
    tolerance: float = DEFAULT_TOLERANCE,
    matched_parts: MatchedParts | None = None,
) -> Iterator[Difference]:
    """Yield the differences of two compiled models above a tolerance."""
    matched_parts = matched_parts or match_parts(one, other)

    for name in OPTIONS:
        before, after = read_option(one, name), read_option(other, name)
        share = relative_change("value", before, after, 1.0)
        if share is None or share > tolerance:
            yield Difference(
                kind="option",
                name="",
                quantity=name,
                before=format_value(before),
                after=format_value(after),
                relative_change=share,
            )
    for name in FLAG_NAMES:
        before, after = read_flag(one, name), read_flag(other, name)
        if before != after:
            yield Difference(
                kind="flag",
                name="",
                quantity=name,
                before="enable" if before else "disable",
                after="enable" if after else "disable",
                relative_change=None,
            )

    for kind, quantities in QUANTITIES.items():
        for before, after in matched_parts.both[kind]:
            if kind == "geom" and not (_has_contacts(one, before) or _has_contacts(other, after)):
                continue
            yield from _part_differences((one, other), kind, (before, after), quantities, tolerance)
        for model, ids, is_new in (
            (one, matched_parts.gone, False),
            (other, matched_parts.new, True),
        ):
            for index in ids[kind]:
                if kind != "geom" or _has_contacts(model, index):
                    yield _one_sided_difference(model, kind, index, is_new=is_new)
    yield from _set_differences("exclude", _excluded_pairs(one), _excluded_pairs(other))
    yield from _sensor_differences(one, other)
    names = {after: name_of(one, "body", before) for before, after in matched_parts.both["body"]}
    own = {before: name_of(one, "body", before) for before, _ in matched_parts.both["body"]}
    yield from _set_differences(
        "filter", *(_touching_pairs(one, own), _touching_pairs(other, names))
    )


def _part_differences(
    models: tuple[mujoco.MjModel, mujoco.MjModel],
    kind: str,
    ids: tuple[int, int],
    quantities: tuple[Quantity, ...],
    tolerance: float,
) -> Iterator[Difference]:
    owners = {"body": None, "joint": models[0].jnt_bodyid, "geom": models[0].geom_bodyid}
    least_length = 1e-3  # length of a part of unknown size, over the model's extent
    least = least_length * float(models[0].stat.extent)
    if kind not in owners:
        length = least
    else:
        owner = owners[kind]
        body = ids[0] if owner is None else int(owner[ids[0]])
        inside = body_reaches(models[0])[body]
        away = float(np.linalg.norm(models[0].body_pos[body]))
        length = float(max(least, inside, away))
    for quantity in quantities:
        before, after = (
            quantity.reader(model, index) for model, index in zip(models, ids, strict=True)
        )
        share = relative_change(quantity.scale, before, after, length)
        if share is None or share > tolerance:
            yield Difference(
                kind=kind,
                name=name_of(models[0], kind, ids[0]),
                quantity=quantity.name,
                before=format_value(before),
                after=format_value(after),
                unit=quantity.unit,
                relative_change=share,
            )


def _one_sided_difference(
    model: mujoco.MjModel, kind: str, index: int, *, is_new: bool
) -> Difference:
    """Return the difference of a part that is in one model only."""
    first = _MAIN_QUANTITY.get(kind)
    quantity = next((one for one in QUANTITIES[kind] if one.name == first), QUANTITIES[kind][0])
    value_text = format_value(quantity.reader(model, index))
    return Difference(
        kind=kind,
        name=name_of(model, kind, index),
        quantity=quantity.name,
        before="" if is_new else value_text,
        after=value_text if is_new else "",
        unit=quantity.unit,
        relative_change=None,
    )


def _has_contacts(model: mujoco.MjModel, geom: int) -> bool:
    is_in_pair = np.isin(geom, [model.pair_geom1, model.pair_geom2])
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom] or is_in_pair)


def _excluded_pairs(model: mujoco.MjModel) -> set[str]:
    pairs = (divmod(int(signature), 1 << 16) for signature in model.exclude_signature)
    return {" - ".join(sorted(name_of(model, "body", body) for body in pair)) for pair in pairs}


def _touching_pairs(model: mujoco.MjModel, names: dict[int, str]) -> set[str]:
    bodies = np.asarray(model.geom_bodyid)
    pairs = {tuple(bodies[[*pair]].tolist()) for pair in np.argwhere(touch_mask(model)).tolist()}
    return {
        " - ".join(sorted((names[first], names[second])))
        for first, second in pairs
        if first in names and second in names
    }


def _sensor_differences(one: mujoco.MjModel, other: mujoco.MjModel) -> Iterator[Difference]:
    # Sensors of the files alone, without those that record.
    before, after = (
        {
            name: mujoco.mjtSensor(int(model.sensor_type[sensor])).name[len("mjSENS_") :].lower()
            for sensor in range(model.nsensor)
            if not (name := model.sensor(sensor).name or f"sensor[{sensor}]").startswith(
                SENSOR_PREFIX
            )
        }
        for model in (one, other)
    )
    for name in [*before, *sorted(after.keys() - before.keys())]:
        if before.get(name) != after.get(name):
            yield Difference(
                kind="sensor",
                name=name,
                quantity="type",
                before=before.get(name, ""),
                after=after.get(name, ""),
                relative_change=None,
            )


def _set_differences(kind: str, before: set[str], after: set[str]) -> Iterator[Difference]:
    """Yield pairs of bodies that are in one model only."""
    words = {"exclude": ("listed", ""), "filter": ("can touch", "cannot touch")}[kind]
    for name in sorted(before ^ after):
        state_words = words if name in before else words[::-1]
        yield Difference(
            kind=kind,
            name=name,
            quantity="bodies",
            before=state_words[0],
            after=state_words[1],
            relative_change=None,
        )


def describe_diff(report: DiffReport) -> Document:
    """Describe the differences of two models; the last sentence is the change in motion."""
    rows = [
        (
            difference.kind,
            difference.name,
            difference.quantity,
            difference.before or "none",
            difference.after or "none",
            difference.unit,
            ""
            if difference.relative_change is None
            else format_amount(difference.relative_change, "%", digits=3),
        )
        for difference in report.differences
    ]
    header = ("kind", "name", "quantity", "before", "after", "unit", "change")
    parts = ", ".join(
        f"{count} {OBJECT_LISTS[kind] if count > 1 else kind}"
        for kind, count in report.matched.items()
        if count
    )
    facts = (
        ("before", report.before),
        ("after", report.after),
        ("engine", f"mujoco {report.mujoco}"),
        ("in both", parts),
    )
    return document_of(
        [Headline(report.headline, outcome_mark("failed" if report.differences else "passed"))],
        [Facts(facts)],
        [table_of(header, rows)] if rows else [],
        [Sentence(report.last_line)],
    )
