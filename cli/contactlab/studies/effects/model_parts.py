"""The features and parts of a model: how each is left out, and whether any motion uses it.

Features and kinds of parts come from the catalogue of modifications. A part that no motion under
load uses, and that has no proof, is checked: without it, the motions must be the same bit for bit.
"""

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.budget import Motion
from contactlab.budget.motion import INTEGRATION
from contactlab.budget.windows import without_sensors
from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.catalogue import (
    CATALOGUE,
    find_safeguards,
    list_features,
    list_reductions,
)
from contactlab.modifications.mechanics import TENDON_FORCE_FIELDS
from contactlab.modifications.model_predicates import may_sleep
from contactlab.modifications.modification import (
    Feature,
    InPlaceChange,
    PartRemoval,
    Settings,
)
from contactlab.modifications.unused_pairs import (
    exclusion_edits,
    own_sensors,
    pairs_within,
    unused_flags,
)
from contactlab.scene.effects.effect import EffectState
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_edits import (
    FLAG_NAMES,
    EditTargets,
    derive_fields,
    write_settings,
)
from contactlab.scene.model_names import geom_names_by_address, name_of
from contactlab.scene.unreachable import filtered_pairs, unreachable_pairs
from contactlab.schema.effects_report import PartKind
from contactlab.studies.verification.run_measures import ENCODER_ANGLE
from contactlab.studies.verification.runs import (
    TRACKING_SECONDS,
    build_tracking_runs,
    hold_inputs,
)
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.stress_motions import KnownStates, visit_states

_NO_TARGETS = EditTargets((), (), None)
_CANNOT_TOUCH = "cannot touch, whatever their joints do within their ranges"
_SLEEP = "sleep"
FAR_PAIRS = "far-pairs"
"""Name of the collisions of bodies that stayed far apart in every run."""
_OF_RECORDING = {"sensor", "energy"}
_OF_PARTS = {"actuation", "tendon", "limit"}
"""Features that are left out part by part."""


@dataclass(frozen=True)
class ModelPart:
    """A feature or part of a model.

    Attributes:
        kind: in reports.
        name: in reports, and of `--keep`.
        edits: that leave it out of the files; None if they cannot.
        change: leaves it out of a compiled model, in place.
        exercised: whether any motion depends on it.
        proof: why it cannot be used; empty without a proof.
        reason_to_stay: why it stays, whatever it saves; empty if it may go.
        adds: whether the edits add it instead.
        recompiles: whether only a model that is compiled from edited files shows its time.
        assumed: the assumption under which it may go although nothing proves it; empty without.
        members: names of the parts, if several go together.
    """

    kind: PartKind
    name: str
    edits: ModelEdits | None
    change: InPlaceChange
    exercised: bool = False
    proof: str = ""
    reason_to_stay: str = ""
    adds: bool = False
    recompiles: bool = False
    assumed: str = ""
    members: tuple[str, ...] = ()

    @property
    def carries_loads(self) -> bool:
        """Whether it may carry more under loads that no run has, as contacts and limits do.

        Runs that hardly load it prove nothing of others.
        """
        if not self.reason_to_stay:
            return False
        effect = EFFECTS.get(self.name) if self.kind == "feature" else None
        return effect is None or effect.kind != "numerical"


def change_model(model: mujoco.MjModel, *changes: InPlaceChange) -> mujoco.MjModel:
    """Return a changed copy of a model."""
    changed_copy = copy.copy(model)
    for change in changes:
        change(changed_copy)
    return changed_copy


def write_features(settings: Settings) -> InPlaceChange:
    """Return the change that writes settings into a compiled model, effects of sweeps included."""

    def edit_model(model: mujoco.MjModel) -> None:
        # Flags that recording sets stay unchanged.
        enabled, disabled = int(model.opt.enableflags), int(model.opt.disableflags)
        own = [name for name in settings if name in FLAG_NAMES]
        derived = write_settings(model, dict(settings), _NO_TARGETS)
        for name, value in settings.items():
            if name in EFFECTS and name not in FLAG_NAMES:
                EFFECTS[name].switch.write(model, bool(value))
        if derived:
            derive_fields(model)
        bits = sum(_flag_bits(name)[0] for name in own), sum(_flag_bits(name)[1] for name in own)
        model.opt.disableflags = disabled & ~bits[0] | int(model.opt.disableflags) & bits[0]
        model.opt.enableflags = enabled & ~bits[1] | int(model.opt.enableflags) & bits[1]

    return edit_model


def _flag_bits(name: str) -> tuple[int, int]:
    word = name.upper()
    return (
        int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{word}", 0)),
        int(getattr(mujoco.mjtEnableBit, f"mjENBL_{word}", 0)),
    )


@dataclass(frozen=True)
class ComparisonLimits:
    """Limits of time on the search for parts.

    Attributes:
        offers_far: whether there is time to offer collisions of pairs that stayed far apart.
        is_late: whether no time is left for comparisons; other parts then count as used.
    """

    offers_far: bool = True
    is_late: Callable[[], bool] = lambda: False


def find_parts(
    checked: CheckedModel,
    model: mujoco.MjModel,
    states: KnownStates,
    positions: Sequence[Floats],
    keep: Sequence[str],
    *,
    with_masks: bool,
    far: float | None = None,
    limits: ComparisonLimits | None = None,
) -> list[ModelPart]:
    """Return the features and parts of a model, and whether any motion depends on each of them.

    Args:
        checked: the model with its task.
        model: the model as compiled from its files.
        states: of the motions of the task, and of those under other loads.
        positions: configurations (T, nq) that proofs take for joints without ranges.
        keep: names of parts that stay.
        with_masks: whether geoms that touch nothing may go: their file has all that they touch.
        far: pairs that stayed at least this far apart may go [m]; None to offer that only.
        limits: of time; None for none.
    """
    motions, limits = states.motions, limits or ComparisonLimits()
    all_parts = [
        *list_model_features(checked, motions[0].model, with_masks=with_masks),
        *_list_collisions(motions, positions, keep, with_masks=with_masks),
        *(
            _list_far_pairs(motions[0].model, positions, keep, far, with_masks=with_masks)
            if limits.offers_far or far is not None
            else ()
        ),
        *_list_limits_and_tendons(motions, keep),
        *_list_actuators(checked, motions[0]),
        *_list_sensors(model, keep),
    ]
    all_parts = [
        replace(part, reason_to_stay=part.reason_to_stay or "--keep") if part.name in keep else part
        for part in all_parts
    ]

    def is_idle(parts: Sequence[ModelPart]) -> bool:
        if limits.is_late():
            return False
        changes = [part.change for part in parts]
        return states.match_models([change_model(motion.model, *changes) for motion in motions])

    idle = [
        part
        for part in all_parts
        if not (part.exercised or part.proof or part.adds or part.assumed)
    ]
    features = [part for part in idle if part.kind == "feature"]
    others = [part for part in idle if part.kind != "feature"]
    used_parts = [*find_used_parts(features, is_idle), *find_used_parts(others, is_idle)]
    return [replace(part, exercised=True) if part in used_parts else part for part in all_parts]


def find_used_parts(
    parts: Sequence[ModelPart], is_idle: Callable[[Sequence[ModelPart]], bool]
) -> list[ModelPart]:
    """Return the parts that any motion depends on, by halves: most parts are idle together."""
    if not parts or is_idle(parts):
        return []
    if len(parts) == 1:
        return [*parts]
    middle = len(parts) // 2
    halves = parts[:middle], parts[middle:]
    return [part for half in halves for part in find_used_parts(half, is_idle)]


def list_model_features(
    checked: CheckedModel, model: mujoco.MjModel, *, with_masks: bool = False
) -> Iterator[ModelPart]:
    """Yield the features that a model has, with those that may be added to save time."""
    states = {rest: _read_effects(checked, rest) for rest in ("all", "auto")}
    safeguards = find_safeguards()
    for feature in list_features():
        name = feature.name
        reason = "a safeguard" if name in safeguards else ""
        if name == _SLEEP and may_sleep(model):
            yield _add_feature(feature, reason)
        if name in _OF_RECORDING | _OF_PARTS or not _has_feature(feature, model, states["all"]):
            continue
        state = states["auto"].get(name)
        proof = "" if state is None or state.on else state.reason
        if proof and name != "contact":
            # MuJoCo's own flags of forces are on in models that have no such force.
            effect = EFFECTS[name]
            if effect.kind == "physical" and effect.switch.flag is not None:
                continue
        if name == "contact" and proof and with_masks:
            reason = ""
        settings = feature.settings_without(model)
        edits = ModelEdits(dict(settings))
        yield ModelPart(
            "feature", name, edits, write_features(settings), proof=proof, reason_to_stay=reason
        )
    if flags := unused_flags(checked.scene.source.model):
        edits = ModelEdits(unflagged=flags)
        proof = "no state depends on it"

        def clear_flags(changed: mujoco.MjModel) -> None:
            for name in flags:
                changed.opt.enableflags &= ~_flag_bits(name)[1]

        yield ModelPart("feature", "energy", edits, clear_flags, proof=proof)


def list_missing_features(checked: CheckedModel, model: mujoco.MjModel) -> Iterator[ModelPart]:
    """Yield the features that a model lacks and that a study can add."""
    states = _read_effects(checked, "all")
    for feature in list_features():
        if feature.on and not _has_feature(feature, model, states) and feature.name != _SLEEP:
            yield _add_feature(feature, "")


def _read_effects(checked: CheckedModel, rest: str) -> dict[str, EffectState]:
    scene = checked.scene.with_effects(rest)
    run = scene.resolve(checked.values, checked.task.seeds[0], checked.duration)
    return dict(scene.prepare(run, scene.initial_states([run])).effects)


def _has_feature(feature: Feature, model: mujoco.MjModel, on: dict[str, EffectState]) -> bool:
    if feature.name in EFFECTS:
        return feature.name in on and on[feature.name].on
    return bool(feature.settings_without(model))


def _add_feature(feature: Feature, reason: str) -> ModelPart:
    edits, change = ModelEdits(dict(feature.on)), write_features(feature.on)
    return ModelPart(
        "feature", feature.name, edits, change, exercised=True, reason_to_stay=reason, adds=True
    )


def _list_sensors(model: mujoco.MjModel, keep: Sequence[str]) -> Iterator[ModelPart]:
    names = tuple(name for name in own_sensors(model) if name not in keep)
    if names:
        yield ModelPart(
            "sensor",
            "sensors",
            ModelEdits(sensors=names),
            lambda _: None,
            proof="no state depends on sensors",
            recompiles=True,
            members=names,
        )


def _list_collisions(
    motions: Sequence[Motion],
    positions: Sequence[Floats],
    keep: Sequence[str],
    *,
    with_masks: bool,
) -> Iterator[ModelPart]:
    own, touching = motions[0].model, _find_touching(motions)
    listed_pairs = [
        (min(pair), max(pair))
        for pair in zip(own.pair_geom1.tolist(), own.pair_geom2.tolist(), strict=True)
    ]
    filtered = filtered_pairs(own)
    candidate_pairs = [
        pair for pair in dict.fromkeys([*filtered, *listed_pairs]) if not _is_kept(own, pair, keep)
    ]
    apart = unreachable_pairs(own, candidate_pairs, positions)
    far = [number for number, pair in enumerate(listed_pairs) if pair in apart]
    edits = exclusion_edits(own, filtered, [*apart], with_masks=with_masks)
    reached = {geom for pair in listed_pairs if pair not in apart for geom in pair}
    ids = [own.geom(name).id for name in edits.masked if name not in keep]
    ids = [geom for geom in ids if geom not in reached]
    words = geom_names_by_address(own)
    if ids:
        yield _leave_out_geoms(own, ids, f"they {_CANNOT_TOUCH}")
    if edits.excluded:
        names = tuple(f"{first} - {second}" for first, second in edits.excluded)
        yield ModelPart(
            "pair",
            _count_parts(names, "pairs of bodies"),
            ModelEdits(excluded=edits.excluded),
            lambda _: None,
            proof=f"their bodies {_CANNOT_TOUCH}",
            recompiles=True,
            members=names,
        )
    removable = [number for number in far if not {*listed_pairs[number]} & {*ids}]
    if removable:
        names = tuple(name_of(own, "pair", number) for number in removable)
        yield ModelPart(
            "pair",
            _count_parts(names, "explicit pairs"),
            ModelEdits(pairs=names),
            _stop_pairs(removable),
            proof=f"their geoms {_CANNOT_TOUCH}",
            recompiles=True,
            members=names,
        )
    for number, pair in enumerate(listed_pairs):
        if number not in far:
            name = name_of(own, "pair", number)
            yield ModelPart(
                "pair",
                name,
                ModelEdits(pairs=(name,)),
                _stop_pairs([number]),
                exercised=pair in touching,
                reason_to_stay="a safeguard",
            )
    geoms = {geom for pair in touching for geom in pair}
    colliding = _find_removal("geom").find_parts(own)
    for geom in sorted({*colliding, *(geom for pair in listed_pairs for geom in pair)} - {*ids}):
        name = name_of(own, "geom", geom)
        part = _leave_out_geoms(own, [geom], "")
        yield replace(
            part,
            name=words.get(name, name),
            exercised=geom in geoms,
            reason_to_stay="a safeguard",
            members=(),
        )


def _list_far_pairs(
    model: mujoco.MjModel,
    positions: Sequence[Floats],
    keep: Sequence[str],
    requested: float | None,
    *,
    with_masks: bool,
) -> Iterator[ModelPart]:
    (offered,) = (one.distance for one in list_reductions() if one.name == FAR_PAIRS)
    distance = requested or offered
    assert distance
    filtered = filtered_pairs(model)
    candidate_pairs = [pair for pair in filtered if not _is_kept(model, pair, keep)]
    near = pairs_within(model, positions, distance) if candidate_pairs else None
    if near is None:
        return
    proved = unreachable_pairs(model, candidate_pairs, positions)
    apart = [pair for pair in candidate_pairs if pair not in near]
    edits = exclusion_edits(model, filtered, apart, with_masks=with_masks)
    if not (edits.masked or edits.excluded) or {*apart} <= {*proved}:
        return
    length = f"{1e3 * distance:g}"
    assumed = f"an assumption: at least {length} mm apart in every run"
    names = (*edits.masked, *(f"{first} - {second}" for first, second in edits.excluded))
    yield ModelPart(
        "pair",
        FAR_PAIRS,
        edits,
        lambda _: None,
        reason_to_stay=""
        if requested
        else f"{assumed}; --apply {FAR_PAIRS}={length}mm leaves them out",
        recompiles=True,
        assumed=assumed,
        members=names,
    )


def _is_kept(model: mujoco.MjModel, pair: tuple[int, int], keep: Sequence[str]) -> bool:
    bodies = [int(model.geom_bodyid[geom]) for geom in pair]
    names = [name_of(model, "geom", geom) for geom in pair]
    names += [name_of(model, "body", body) for body in bodies]
    return not {*names}.isdisjoint(keep)


def _count_parts(names: Sequence[str], kind: str) -> str:
    return names[0] if len(names) == 1 else f"{len(names)} {kind}"


def _leave_out_geoms(model: mujoco.MjModel, geoms: Sequence[int], proof: str) -> ModelPart:
    # A mask does not concern explicit pairs, so these go, too.
    pairs = np.flatnonzero(np.isin(model.pair_geom1, geoms) | np.isin(model.pair_geom2, geoms))
    names = tuple(name_of(model, "geom", geom) for geom in geoms)
    stop = _stop_pairs(pairs.tolist())

    def edit_model(changed: mujoco.MjModel) -> None:
        changed.geom_contype[list(geoms)] = changed.geom_conaffinity[list(geoms)] = 0
        stop(changed)

    edits = ModelEdits(
        masked=names, pairs=tuple(name_of(model, "pair", int(pair)) for pair in pairs)
    )
    name = _count_parts(names, "geoms")
    return ModelPart("geom", name, edits, edit_model, proof=proof, members=names)


def _stop_pairs(pairs: Sequence[int]) -> InPlaceChange:
    def edit_model(model: mujoco.MjModel) -> None:
        model.pair_margin[list(pairs)] = -1e6  # m, so that the pairs never touch

    return edit_model


def _find_touching(motions: Sequence[Motion]) -> set[tuple[int, int]]:
    # Pairs of geoms with a contact in any step of any seed.
    touching_pairs = set[tuple[int, int]]()
    for motion in motions:
        model = without_sensors(motion.model)
        data = mujoco.MjData(model)
        for seed in range(motion.seeds):
            mujoco.mj_setState(model, data, motion.starts[seed], INTEGRATION)
            rows = motion.rows(seed, np.arange(motion.steps))
            for step in range(motion.steps):
                if rows is not None:
                    mujoco.mj_setState(model, data, rows[step], motion.spec)
                mujoco.mj_step(model, data)
                if data.ncon:
                    geoms = np.sort(data.contact.geom[data.contact.exclude == 0], axis=1)
                    touching_pairs.update(map(tuple, geoms.tolist()))
    return touching_pairs


def _list_limits_and_tendons(motions: Sequence[Motion], keep: Sequence[str]) -> Iterator[ModelPart]:
    model = motions[0].model
    limits, tendons = _find_removal("limit"), _find_removal("tendon")
    for joint in limits.find_parts(model):
        change = _zero_fields(joint, limits.fields)
        name = name_of(model, "joint", joint)
        yield ModelPart("limit", name, None, change, reason_to_stay="a safeguard")
    idle = [
        tendon
        for tendon in range(model.ntendon)
        if _is_idle_tendon(model, tendon) and name_of(model, "tendon", tendon) not in keep
    ]
    if idle:
        names = tuple(name_of(model, "tendon", tendon) for tendon in idle)
        sensors = tuple(name for tendon in idle for name in _sensors_of_tendon(model, tendon))
        yield ModelPart(
            "tendon",
            _count_parts(names, "tendons"),
            ModelEdits(tendons=names, sensors=sensors),
            lambda _: None,
            proof="they exert no force, and nothing pulls on them",
            recompiles=True,
            members=names,
        )
    for tendon in range(model.ntendon):
        name = name_of(model, "tendon", tendon)
        if _is_idle_tendon(model, tendon):
            continue
        pulls = [field for field in tendons.fields if np.any(getattr(model, field, [0])[tendon])]
        if pulls:
            yield ModelPart("tendon", name, None, _zero_fields(tendon, tendons.fields))


def _is_idle_tendon(model: mujoco.MjModel, tendon: int) -> bool:
    # It neither pulls nor transmits, nor limits anything.
    forces = (*TENDON_FORCE_FIELDS, "tendon_armature", "tendon_limited", "tendon_actfrclimited")
    pulls = any(np.any(getattr(model, field)[tendon]) for field in forces if hasattr(model, field))
    driven = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)
    tied = model.eq_type == int(mujoco.mjtEq.mjEQ_TENDON)
    ends = [
        *model.actuator_trnid[driven, 0].tolist(),
        *model.eq_obj1id[tied].tolist(),
        *model.eq_obj2id[tied].tolist(),
    ]
    return not pulls and tendon not in ends and not model.nplugin


def _sensors_of_tendon(model: mujoco.MjModel, tendon: int) -> tuple[str, ...]:
    kind = int(mujoco.mjtObj.mjOBJ_TENDON)
    own = (model.sensor_objtype == kind) & (model.sensor_objid == tendon)
    names = (model.sensor(int(each)).name or f"sensor[{each}]" for each in np.flatnonzero(own))
    return tuple(name for name in names if name in own_sensors(model))


def _find_removal(kind: PartKind) -> PartRemoval:
    removals = (one for entry in CATALOGUE.values() for one in entry.removals)
    return next(one for one in removals if one.kind == kind)


def _zero_fields(index: int, fields: Sequence[str]) -> InPlaceChange:
    def edit_model(model: mujoco.MjModel) -> None:
        for field in fields:
            if hasattr(model, field):
                getattr(model, field)[index] = 0

    return edit_model


def _list_actuators(checked: CheckedModel, motion: Motion) -> Iterator[ModelPart]:
    # An actuator that moves anything when it is commanded alone is exercised. Its force in windows
    # of the task does not show that: they begin where it has moved things.
    model = motion.model
    moves = find_moving_actuators(motion, checked.threads)
    for actuator in _find_removal("actuator").find_parts(model):
        name = name_of(model, "actuator", actuator)
        change = _zero_fields(actuator, _find_removal("actuator").fields)
        way = float(moves[actuator])
        reason = f"moves its joint by {way:.2g}" if way > ENCODER_ANGLE else "a safeguard"
        moved = way > ENCODER_ANGLE
        yield ModelPart("actuator", name, None, change, exercised=moved, reason_to_stay=reason)


def find_moving_actuators(motion: Motion, threads: int) -> Floats:
    """Return (nu,) how far each actuator alone moves any coordinate by a step of its control.

    Coordinates are in rad and m, and compared with those under the controls of the start.
    """
    model = motion.model
    ways = np.zeros(model.nu)
    if not model.nu:
        return ways
    run = build_tracking_runs(motion, motion, range(model.nu))[0].original
    held_motion = hold_inputs(motion, TRACKING_SECONDS, lambda own: own)
    still = replace(held_motion, starts=held_motion.starts[:1], inputs=held_motion.inputs[:1])
    excited, unmoved = (visit_states(each, threads)[:, :-1, : model.nq] for each in (run, still))
    return np.nan_to_num(np.abs(excited - unmoved)).max(axis=(1, 2))
