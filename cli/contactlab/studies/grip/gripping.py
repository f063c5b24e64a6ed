"""Judges a grip: finds the fingers, closes them on an object, loads it, and runs what may help."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from contactlab.errors import SceneError, SweepFileError
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.angle_units import in_radians
from contactlab.scene.compile_model import compile_model
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.scene.mujoco_versions import VERSION
from contactlab.scene.scene_source import find_scene
from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.examination import MOST_CHANGES
from contactlab.schema.grip import (
    GripCause,
    GripControl,
    GripDrift,
    GripFinger,
    GripPlacement,
    GripPull,
    GripRemedy,
    GripReport,
    GripTrial,
)
from contactlab.studies.grip.bench import Bench, Rig, cut_free, with_object
from contactlab.studies.grip.closing import (
    Closing,
    Squeeze,
    close_at,
    find_closing,
    fitted,
    pads_centre,
    squeeze,
)
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.gripped_object import USUAL, GrippedObject, read_object
from contactlab.studies.grip.holding import (
    Drift,
    Load,
    Trial,
    gravity_of,
    pulled,
    shaken,
    turned,
    weight,
)
from contactlab.studies.grip.in_keyframe import held_in
from contactlab.studies.grip.judging import Evidence, causes, speed_of, word_of, worst_of
from contactlab.studies.grip.remedies import Grip, Tried, least_force, tried_on

WITHIN = 1e-4  # m/s: a millimetre in the ten seconds that a pick and place takes
_ALIKE = 1.1  # ratio of costs that are equal
_WORSE = 1.1  # ratio of speeds
_SMALLER = (1.0, 0.75, 0.5)  # of the usual object, where there is no room for it
_NEAR = 0.01  # of a squeeze that is asked for
_BENCH = ("out of the hand", "into the hand")
_KEYFRAME = ("up", "down")
_FILTERED = (
    "the hand is mounted on the world here: contacts of its base with the first links, which "
    "MuJoCo filters on an arm, are left out"
)
_NO_MORE = "more squeeze was not exercised: the ranges of control end here"


@dataclass(frozen=True)
class GripRequest:
    """Which grip to judge.

    Attributes:
        model: a scene, its folder, a model file, or a robot.
        held: the object, as `read_object` takes it; in a keyframe, the body.
        keyframe: one in which something is held, which is judged as it is.
        squeeze: force of a finger [N]; what the controls' ends give by default.
        base: the body that carries the fingers.
        within: speed from which an object creeps [m/s].
        remedies: whether to run changes that may help.
        placements: whether to grip the object elsewhere too, and of other sizes.
        told: called with a line of text as a part begins.
        film: called with the grip once it is judged.
    """

    model: str
    held: str | None = None
    keyframe: str | None = None
    squeeze: float | None = None
    base: str | None = None
    within: float = WITHIN
    remedies: bool = True
    placements: bool = True
    told: Callable[[str], None] = lambda _: None
    film: Callable[[Grip], None] | None = None


@dataclass(frozen=True)
class _Setup:
    """A grip, and how it was made on a bench."""

    grip: Grip
    bench: Bench | None
    given: GrippedObject | None
    notes: tuple[str, ...] = ()


def run(request: GripRequest) -> GripReport:
    """Judge a grip.

    Raises:
        SceneError: there is no such model, keyframe or body; nothing closes, or nothing is held.
        SweepFileError: a squeeze is asked for in a keyframe, or more than the actuators give.
    """
    setup = _in_keyframe(request) if request.keyframe else _on_bench(request)
    grip = setup.grip
    request.told(
        f"closed on {_held_words(setup)}: {least_force(grip.held):.3g} N a finger; loading"
    )
    drifts = grip.drifts()
    word = word_of(drifts, request.within)
    ways = grip.ways()
    down = ways[grip.names[1] if setup.bench is None else grip.names[0]]
    across = dict(list(ways.items())[:4])
    trials = [each(grip.rig, grip.held, grip.load, down) for each in (shaken, turned)]
    pull = pulled(grip.rig, grip.held, grip.load, across)
    tried = list[Tried]()
    if word != "holds" and request.remedies:
        request.told(f"it {word}; running changes that may help")
        tried = tried_on(grip, request.within)
    known = Evidence(
        word=word,
        speed=speed_of(drifts),
        idle=drifts[0].speed if setup.bench else 0.0,
        pressed=grip.held.is_held,
        pull=pull[1],
        weight=weight(grip.rig, grip.load),
        deep=_deep(grip),
        tried=_least(tried),
    )
    remedies = _remedies(request, known.speed, tried)
    why = tuple(GripCause(kind=kind, sentence=text) for kind, text in causes(known))
    if request.film is not None:
        request.film(grip)
    model = grip.rig.model
    return GripReport(
        model=request.model,
        mujoco=VERSION,
        keyframe=request.keyframe,
        verdict=word,
        sentence=_sentence(setup, drifts, word, why, remedies),
        within=request.within,
        held=_held_words(setup),
        base=model.body(grip.rig.base).name,
        opening=grip.closing.opening if grip.closing else None,
        controls=tuple(_controls(grip)),
        fingers=tuple(_fingers(grip)),
        depth=grip.held.depth,
        depth_share=known.deep,
        weight=known.weight,
        drifts=tuple(map(_drift_report, drifts)),
        shake=_trial_report(trials[0]),
        turn=_trial_report(trials[1]),
        pull=GripPull(direction=pull[0], force=pull[1], weights=pull[1] / known.weight),
        placements=(
            tuple(_placements(setup, drifts, request.within)) if request.placements else ()
        ),
        causes=why,
        remedies=remedies,
        notes=tuple(_notes(setup, tried)),
    )


def _compiled(request: GripRequest) -> tuple[mujoco.MjModel, mujoco.MjSpec, tuple[str, ...]]:
    """Return a model, its specification, in which everything has a name, and notes of its units."""
    kept = list[mujoco.MjSpec]()
    source = find_scene(request.model)
    model = compile_model(source, {}, lambda spec: kept.append(spec.copy()))
    reads_degrees = kept[0].compiler.degree and source.model.suffix != ".urdf"
    messages = [message for _, message in in_radians(model)] if reads_degrees else []
    notes = (f"{message} (contactlab lint); no number here is the robot's" for message in messages)
    return model, kept[0], tuple(notes)


def _in_keyframe(request: GripRequest) -> _Setup:
    if request.squeeze is not None:
        raise SweepFileError("--squeeze would be ignored: a keyframe is judged with its controls")
    model, _, notes = _compiled(request)
    assert request.keyframe is not None
    rig, held = held_in(model, request.keyframe, request.held, request.base)
    return _Setup(Grip(rig, held, Load.of_object(rig), _KEYFRAME, None), None, None, notes)


def _on_bench(request: GripRequest) -> _Setup:
    given = read_object(request.held)
    model, spec, notes = _compiled(request)
    hand = find_hand(model, request.base)
    bench = cut_free(spec, model, hand, given.name if given.shape == "body" else "")
    rig = with_object(bench, given)
    closing = find_closing(rig)
    if request.held is None:
        given, rig, held = _squeezed_usual(bench, rig, closing)
    else:
        box = replace(USUAL, size=(2 * float(rig.half[0]), *USUAL.size[1:]))
        is_box = given.shape == "box"
        centre = None if is_box else pads_centre(with_object(bench, box), closing)
        held = squeeze(rig, closing, centre)
    if request.squeeze is not None:
        held = _squeezed(rig, closing, held, request.squeeze)
    load = Load.of_all(rig, gravity_of(model))
    return _Setup(Grip(rig, held, load, _BENCH, closing), bench, given, notes)


def _squeezed_usual(bench: Bench, rig: Rig, closing: Closing) -> tuple[GrippedObject, Rig, Squeeze]:
    """Return the first of the usual object and smaller ones that opened fingers have room for."""
    for factor in _SMALLER:
        tried = fitted(rig, closing, factor)
        other = rig if tried == USUAL else with_object(bench, tried)
        try:
            return tried, other, squeeze(other, closing)
        except SceneError:
            if factor == _SMALLER[-1]:
                raise
    raise AssertionError


def _squeezed(rig: Rig, closing: Closing, held: Squeeze, force: float) -> Squeeze:
    """Return a squeeze of so much a finger [N], by halving what controls it is between."""
    most = least_force(held)
    if not 0 < force <= most * (1 + _NEAR):
        raise SweepFileError(
            f"--squeeze {force:g}: the actuators give {most:.3g} N a finger at the end of their "
            "range; write at most that"
        )
    assert held.approach is not None
    low, high, found = 0.0, 1.0, held
    while abs(least_force(found) - force) > _NEAR * force and high - low > _NEAR**2:
        share = (low + high) / 2
        found = close_at(rig, closing, held.approach, closing.control(share))
        low, high = (low, share) if least_force(found) > force else (share, high)
    return found


def _held_words(setup: _Setup) -> str:
    if setup.given is not None:
        return setup.given.words
    rig = setup.grip.rig
    return f"body {rig.model.body(rig.body).name}"


def _deep(grip: Grip) -> float:
    """Return depth over half of the object's extent from finger to finger."""
    turn = np.empty(9)
    place = grip.rig.address + 3
    mujoco.mju_quat2Mat(turn, grip.held.path[-1][place : place + 4])
    width = float(np.abs(turn.reshape(3, 3).T @ grip.held.turn[:, 0]) @ grip.rig.half)
    return grip.held.depth / width


def _least(tried: Sequence[Tried]) -> dict[str, float]:
    """Return the least speed that changes of a kind leave, by what they are against."""
    found = dict[str, float]()
    for each in tried:
        found[each.against] = min(found.get(each.against, math.inf), speed_of(each.drifts))
    return found


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _drift_report(drift: Drift) -> GripDrift:
    return GripDrift(
        name=drift.name,
        seconds=drift.seconds,
        speeds=tuple(map(_finite, drift.speeds)),
        trend=drift.trend,
        speed=_finite(drift.speed),
        lost=_finite(drift.lost),
    )


def _trial_report(trial: Trial) -> GripTrial:
    return GripTrial(way=_finite(trial.way), lost=trial.lost)


def _controls(grip: Grip) -> Iterator[GripControl]:
    """Yield the controls that close, with what their actuators give."""
    model = grip.rig.model
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, grip.held.row, mujoco.mjtState.mjSTATE_INTEGRATION.value)
    mujoco.mj_forward(model, data)
    for actuator in range(model.nu):
        opened = None if grip.closing is None else float(grip.closing.opened[actuator])
        if opened is not None and opened == grip.held.control[actuator]:
            continue
        force = float(data.actuator_force[actuator])
        limited = bool(model.actuator_forcelimited[actuator])
        most = float(model.actuator_forcerange[actuator][int(force > 0)]) if limited else None
        yield GripControl(
            name=model.actuator(actuator).name,
            opened=opened,
            closed=float(grip.held.control[actuator]),
            force=force,
            limit=None if most is None else abs(most),
        )


def _fingers(grip: Grip) -> Iterator[GripFinger]:
    model = grip.rig.model
    bodies = [*(finger[0] for finger in grip.rig.fingers), grip.rig.base]
    for body, force in zip(bodies, grip.held.forces, strict=True):
        if force > 0 or body != grip.rig.base:
            yield GripFinger(body=model.body(body).name, force=force)


def _placements(setup: _Setup, drifts: Sequence[Drift], within: float) -> Iterator[GripPlacement]:
    """Yield what becomes of the object as it is, beside there, and of other sizes."""
    grip = setup.grip
    begun = grip.held.approach
    if setup.bench is None or grip.closing is None or begun is None or not grip.held.is_held:
        return
    yield _placement("as it is", grip, drifts, within)
    rig, turn = grip.rig, grip.held.turn
    for name, axis in (("half its breadth aside", 1), ("half its length further out", 2)):
        offset = turn[:, axis] * rig.half[axis]
        approach = replace(begun, point=begun.point + offset / 2, turn=turn)
        held = close_at(rig, grip.closing, approach, grip.held.control)
        moved = replace(grip, held=replace(held, turn=turn))
        yield _placement(name, moved, moved.drifts(), within)
    if setup.given is None or setup.given.shape in ("body", "mesh"):
        return
    for name, factor in (("a tenth smaller", 0.9), ("a tenth larger", 1.1)):
        other = with_object(setup.bench, setup.given.scaled(factor))
        try:
            held = squeeze(other, grip.closing, grip.held.points.mean(axis=0))
        except SceneError:
            continue  # it does not fit between the fingers, or they do not close as far
        sized = replace(grip, rig=other, held=held, load=Load.of_all(other, grip.load.gravity))
        yield _placement(name, sized, sized.drifts(), within)


def _placement(name: str, grip: Grip, drifts: Sequence[Drift], within: float) -> GripPlacement:
    return GripPlacement(
        name=name,
        force=least_force(grip.held),
        speed=_finite(speed_of(drifts)),
        verdict=word_of(drifts, within),
    )


def _remedies(request: GripRequest, speed: float, tried: Sequence[Tried]) -> tuple[GripRemedy, ...]:
    """Return remedies by use: what holds, then the cheapest, then the simplest; with lines."""

    def use(place: int) -> tuple[bool, float, float]:
        each = tried[place]
        holds = word_of(each.drifts, request.within) == "holds"
        cost = round(math.log(each.price.ratio, _ALIKE)) if each.price else math.inf
        return not holds, cost if holds else speed_of(each.drifts), place

    made = list[GripRemedy]()
    scenes = SceneLoader(Path())
    for place in sorted(range(len(tried)), key=use):
        each = tried[place]
        word = word_of(each.drifts, request.within)
        lines, unwritten = (), ""
        if word == "holds" and each.options and len(made) < MOST_CHANGES:
            lines, unwritten = _lines(request, scenes, each)
        left = speed_of(each.drifts)
        made.append(
            GripRemedy(
                name=each.name,
                options=dict(each.options),  # pyright: ignore[reportArgumentType] - settings
                speed=_finite(left),
                verdict=word,
                worse=left > _WORSE * speed,
                price=each.price and BudgetPrice(**each.price._asdict()),
                lines=lines,
                unwritten=unwritten,
            )
        )
    return tuple(made)


def _lines(request: GripRequest, scenes: SceneLoader, each: Tried) -> tuple[tuple[str, ...], str]:
    """Return the lines of the model's files that make a change; else why there are none."""
    try:
        scene = scenes.open(request.model).with_effects("all")
        with TemporaryDirectory(prefix="contactlab-") as folder:
            return write_model(scene, ModelEdits(each.options), Path(folder) / "changed").lines, ""
    except SceneError as error:
        return (), str(error).splitlines()[0]


def _notes(setup: _Setup, tried: Sequence[Tried]) -> Iterator[str]:
    yield from setup.notes
    if setup.bench is not None:
        yield _FILTERED
    if tried and not any(each.against == "squeeze" for each in tried):
        yield _NO_MORE


def _sentence(
    setup: _Setup,
    drifts: Sequence[Drift],
    word: str,
    why: Sequence[GripCause],
    remedies: Sequence[GripRemedy],
) -> str:
    """Return a verdict in one sentence: how fast, where to, when it is lost, why, what helps."""
    worst, force = worst_of(drifts), least_force(setup.grip.held)
    what = _held_words(setup)
    if word == "holds":
        where = f" ({worst.name})" if worst.speed > 0 else ""
        return f"holds {what}: at most {_speed(worst.speed)}{where}, {force:.3g} N a finger"
    reason = f": {why[0].sentence}" if why else ""
    if not setup.grip.held.is_held:
        told = f"drops {what}{reason}"
    elif word == "drops":
        told = f"drops {what}: lost after {worst.lost:.2g} s, {worst.name}{reason}"
    else:
        end = f", lost after {worst.lost:.3g} s" if math.isfinite(worst.lost) else ""
        told = f"creeps: {what} goes {_speed(worst.speed)} {worst.name}, {worst.trend}{end}{reason}"
    best = next((each for each in remedies if each.verdict == "holds"), None)
    if best is None:
        return f"{told}; none of the changes tried holds it" if remedies else told
    cost = f", at {best.price.ratio:.2g} times the time" if best.price else ""
    return f"{told}; held by {best.name} ({_speed(best.speed or 0.0)}){cost}"


def _speed(speed: float) -> str:
    return f"{1e3 * speed:.3g} mm/s"
