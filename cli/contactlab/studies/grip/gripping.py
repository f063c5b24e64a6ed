"""Judges a grip: finds the fingers, closes them on an object, loads it, and tests fixes."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco

from contactlab.errors import SceneError, SweepFileError
from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.angle_units import find_radian_angles
from contactlab.scene.compile_model import compile_model
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import write_model
from contactlab.scene.mujoco_versions import VERSION
from contactlab.scene.scene_source import find_scene
from contactlab.schema.examination import MOST_FIXES
from contactlab.schema.grip import (
    GripCause,
    GripControl,
    GripDrift,
    GripFinger,
    GripFix,
    GripPlacement,
    GripPull,
    GripReport,
)
from contactlab.schema.time_ratio import cost_class
from contactlab.step_progress import step_names
from contactlab.studies.grip.closing import (
    Closing,
    Squeeze,
    close_at,
    find_closing,
    fit_object,
    pads_center,
    squeeze_object,
)
from contactlab.studies.grip.fingers import find_hand
from contactlab.studies.grip.grip_fixes import Grip, TestedFix, run_fixes, weakest_finger_force
from contactlab.studies.grip.grip_fixture import GripFixture, MountedHand, add_object, mount_hand
from contactlab.studies.grip.grip_verdict import (
    GripEvidence,
    find_causes,
    verdict_of,
    worst_drift,
    worst_speed,
)
from contactlab.studies.grip.gripped_object import DEFAULT_OBJECT, GrippedObject, read_object
from contactlab.studies.grip.holding import (
    Drift,
    Load,
    gravity_magnitude,
    object_weight,
    pull_object,
    shake_object,
    turn_object,
)
from contactlab.studies.grip.keyframe_grip import find_held_object
from contactlab.temporary_folders import temporary_folder


@dataclass(frozen=True)
class GripRequest:
    """The grip to judge.

    Attributes:
        model: a scene, its folder, a model file, or a robot.
        held_body: the object, see `read_object`; in a keyframe, the body.
        keyframe: a keyframe with a held object.
        squeeze: force of a finger [N]; default: the force at the ends of control ranges.
        base: the body that carries the fingers.
        tolerance: an object with a larger speed creeps [m/s]; by default, one that moves 1 mm in
            the ten seconds of a pick and place.
        fixes: whether to test fixes.
        placements: whether to test other places and sizes of the object.
        notify: called with a line of text at each stage.
        film: called with the grip after all measurements.
    """

    model: str
    held_body: str | None = None
    keyframe: str | None = None
    squeeze: float | None = None
    base: str | None = None
    tolerance: float = 1e-4
    fixes: bool = True
    placements: bool = True
    notify: Callable[[str], None] = lambda _: None
    film: Callable[[Grip], None] | None = None


@dataclass(frozen=True)
class _Setup:
    """A grip, and how it was set up."""

    grip: Grip
    mounted_hand: MountedHand | None
    given_object: GrippedObject | None
    notes: tuple[str, ...] = ()


def judge_grip(request: GripRequest) -> GripReport:
    """Judge a grip.

    Raises:
        SceneError: there is no such model, keyframe or body; nothing closes, or nothing is held.
        SweepFileError: a squeeze is requested for a keyframe, or is more than the actuators give.
    """
    with step_names(5 if request.fixes else 4) as begin_step:
        begin_step("closing the hand")
        setup = _read_keyframe(request) if request.keyframe else _mount_and_close(request)
        grip = setup.grip
        force = weakest_finger_force(grip.squeeze)
        request.notify(f"closed on {_object_words(setup)} with {force:.3g} N per finger; loading")
        begin_step("pulling in six directions")
        drifts = grip.measure_drifts()
        deep = grip.depth_share
        word = verdict_of(drifts, request.tolerance, deep)
        directions = grip.directions()
        down = directions[grip.names[1] if setup.mounted_hand is None else grip.names[0]]
        across = dict(list(directions.items())[:4])
        begin_step("shaking and turning")
        trials = [
            each(grip.fixture, grip.squeeze, grip.load, down)
            for each in (shake_object, turn_object)
        ]
        begin_step("pulling it out")
        direction, pull = pull_object(grip.fixture, grip.squeeze, grip.load, across)
        tested_fixes = list[TestedFix]()
        if word != "holds" and request.fixes:
            request.notify(f"it {word}; testing fixes")
            begin_step("testing fixes")
            tested_fixes = run_fixes(grip, request.tolerance)
        fixes = _fix_rows(request, drifts, tested_fixes)
        placements = (
            tuple(_placement_rows(setup, drifts, request.tolerance)) if request.placements else ()
        )
        if request.film is not None:
            request.film(grip)

    # The least speed over fixes, by the cause that they test.
    speeds = dict[str, float]()
    for each in tested_fixes:
        speeds[each.against] = min(speeds.get(each.against, math.inf), worst_speed(each.drifts))
    evidence = GripEvidence(
        word=word,
        speed=worst_speed(drifts),
        idle=drifts[0].speed if setup.mounted_hand else 0.0,
        pressed=grip.squeeze.is_held,
        pull=pull,
        weight=object_weight(grip.fixture, grip.load),
        deep=deep,
        speeds_with_fixes=speeds,
        tolerance=request.tolerance,
    )
    why = tuple(GripCause(kind=kind, sentence=text) for kind, text in find_causes(evidence))

    model = grip.fixture.model
    pressing = zip(
        [*(finger[0] for finger in grip.fixture.fingers), grip.fixture.base],
        grip.squeeze.forces,
        strict=True,
    )
    fingers = [
        GripFinger(body=model.body(body).name, force=force)
        for body, force in pressing
        if force > 0 or body != grip.fixture.base
    ]
    controls, notes = tuple(_control_rows(grip)), list(setup.notes)
    if setup.mounted_hand is not None:
        notes.append(
            "The base of the hand is fixed to the world. Contacts of the base with the first "
            "links, which MuJoCo filters on an arm, are excluded."
        )
    if tested_fixes and not any(each.against == "squeeze" for each in tested_fixes):
        notes.append(_explain_no_squeeze(controls))
    return GripReport(
        model=request.model,
        mujoco=VERSION,
        keyframe=request.keyframe,
        verdict=word,
        sentence=_grip_sentence(setup, drifts, word, why, fixes)
        + mention_worse_places(word, placements),
        tolerance=request.tolerance,
        object=_object_words(setup),
        base=model.body(grip.fixture.base).name,
        opening=grip.closing.opening if grip.closing else None,
        controls=controls,
        fingers=tuple(fingers),
        depth=grip.squeeze.depth,
        depth_share=evidence.deep,
        weight=evidence.weight,
        drifts=tuple(map(_drift_report, drifts)),
        shake=trials[0],
        turn=trials[1],
        pull=GripPull(direction=direction, force=pull, weights=pull / evidence.weight),
        placements=placements,
        causes=why,
        fixes=fixes,
        notes=tuple(notes),
    )


def _compile_request(request: GripRequest) -> tuple[mujoco.MjModel, mujoco.MjSpec, tuple[str, ...]]:
    """Return a model, its specification with all parts named, and notes on its units."""
    spec_copies = list[mujoco.MjSpec]()
    source = find_scene(request.model)
    model = compile_model(source, {}, lambda spec: spec_copies.append(spec.copy()))
    reads_degrees = spec_copies[0].compiler.degree and source.model.suffix != ".urdf"
    messages = [message for _, message in find_radian_angles(model)] if reads_degrees else []
    notes = (f"{message} (contactlab lint), so all numbers here are wrong" for message in messages)
    return model, spec_copies[0], tuple(notes)


def _read_keyframe(request: GripRequest) -> _Setup:
    if request.squeeze is not None:
        raise SweepFileError("--squeeze would be ignored: a keyframe is judged with its controls")
    model, _, notes = _compile_request(request)
    assert request.keyframe is not None
    fixture, squeeze = find_held_object(model, request.keyframe, request.held_body, request.base)
    grip = Grip(fixture, squeeze, Load.of_object(fixture), ("up", "down"), None)
    return _Setup(grip, None, None, notes)


def _mount_and_close(request: GripRequest) -> _Setup:
    gripped_object = read_object(request.held_body)
    model, spec, notes = _compile_request(request)
    hand = find_hand(model, request.base)
    mounted_hand = mount_hand(
        spec, model, hand, gripped_object.name if gripped_object.shape == "body" else ""
    )
    fixture = add_object(mounted_hand, gripped_object)
    closing = find_closing(fixture)
    centre = None
    if request.held_body is None:
        gripped_object, fixture, squeeze = _squeeze_default_object(mounted_hand, fixture, closing)
    else:
        box = replace(DEFAULT_OBJECT, size=(2 * float(fixture.half[0]), *DEFAULT_OBJECT.size[1:]))
        is_box = gripped_object.shape == "box"
        centre = None if is_box else pads_center(add_object(mounted_hand, box), closing)
        squeeze = squeeze_object(fixture, closing, centre)
    if request.squeeze is not None:
        tolerance = 0.01  # of the force, relative
        most = weakest_finger_force(squeeze)
        if not 0 < request.squeeze <= most * (1 + tolerance):
            raise SweepFileError(
                f"--squeeze {request.squeeze:g}: the actuators give {most:.3g} N per finger at "
                "the end of their range; write at most that"
            )
        assert squeeze.approach is not None
        low, high, best_squeeze = 0.0, 1.0, squeeze
        while (
            abs(weakest_finger_force(best_squeeze) - request.squeeze) > tolerance * request.squeeze
            and high - low > tolerance**2
        ):
            share = (low + high) / 2
            best_squeeze = close_at(fixture, closing, squeeze.approach, closing.control_at(share))
            low, high = (
                (low, share)
                if weakest_finger_force(best_squeeze) > request.squeeze
                else (share, high)
            )
        squeeze = best_squeeze
    load = Load.of_all(fixture, gravity_magnitude(model))

    def close_again(changed: GripFixture) -> tuple[Closing, Squeeze]:
        own = find_closing(changed)
        return own, squeeze_object(changed, own, centre)

    directions = ("out of the hand", "into the hand")
    grip = Grip(fixture, squeeze, load, directions, closing, close_again)
    return _Setup(grip, mounted_hand, gripped_object, notes)


def _squeeze_default_object(
    mounted_hand: MountedHand, fixture: GripFixture, closing: Closing
) -> tuple[GrippedObject, GripFixture, Squeeze]:
    """Return the first scale of the default object that the opened fingers have room for."""
    scales = 1.0, 0.75, 0.5
    for factor in scales:
        fitted_object = fit_object(fixture, closing, factor)
        other = (
            fixture if fitted_object == DEFAULT_OBJECT else add_object(mounted_hand, fitted_object)
        )
        try:
            return fitted_object, other, squeeze_object(other, closing)
        except SceneError:
            if factor == scales[-1]:
                raise
    raise AssertionError


def _object_words(setup: _Setup) -> str:
    if setup.given_object is not None:
        return setup.given_object.words
    fixture = setup.grip.fixture
    return f"body {fixture.model.body(fixture.body).name}"


def _drift_report(drift: Drift) -> GripDrift:
    return GripDrift(
        name=drift.name,
        seconds=drift.seconds,
        speeds=drift.speeds,
        trend=drift.trend,
        speed=drift.speed,
        lost_after=drift.lost,
    )


def _control_rows(grip: Grip) -> Iterator[GripControl]:
    """Yield the controls that close, with the forces of their actuators."""
    model = grip.fixture.model
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, grip.squeeze.row, mujoco.mjtState.mjSTATE_INTEGRATION.value)
    mujoco.mj_forward(model, data)
    for actuator in range(model.nu):
        opened = None if grip.closing is None else float(grip.closing.open_controls[actuator])
        if opened is not None and opened == grip.squeeze.control[actuator]:
            continue
        force = float(data.actuator_force[actuator])
        limited = bool(model.actuator_forcelimited[actuator])
        most = float(model.actuator_forcerange[actuator][int(force > 0)]) if limited else None
        yield GripControl(
            name=model.actuator(actuator).name,
            open_control=opened,
            closed_control=float(grip.squeeze.control[actuator]),
            force=force,
            limit=None if most is None else abs(most),
        )


def _explain_no_squeeze(controls: Sequence[GripControl]) -> str:
    full = [
        each.name
        for each in controls
        if each.limit and math.isclose(abs(each.force), each.limit, rel_tol=COARSE_ROUNDING)
    ]
    if not full:
        return "More squeeze was not tested, since the control ranges end here."
    return (
        f"More squeeze was not tested, since {' and '.join(full)} press with their largest force."
    )


def _placement_rows(
    setup: _Setup, drifts: Sequence[Drift], within: float
) -> Iterator[GripPlacement]:
    """Yield the grip with the unchanged object, with it elsewhere, and with other sizes."""
    grip = setup.grip
    first_approach = grip.squeeze.approach
    if (
        setup.mounted_hand is None
        or grip.closing is None
        or first_approach is None
        or not grip.squeeze.is_held
    ):
        return
    yield _placement_row("as it is", grip, drifts, within)
    fixture, turn = grip.fixture, grip.squeeze.turn
    for name, axis in (("half a width aside", 1), ("half a length further out", 2)):
        offset = turn[:, axis] * fixture.half[axis]
        approach = replace(first_approach, point=first_approach.point + offset / 2, turn=turn)
        squeeze = close_at(fixture, grip.closing, approach, grip.squeeze.control)
        moved = replace(grip, squeeze=replace(squeeze, turn=turn))
        yield _placement_row(name, moved, moved.measure_drifts(), within)
    if setup.given_object is None or setup.given_object.shape in ("body", "mesh"):
        return
    for name, factor in (("a tenth smaller", 0.9), ("a tenth larger", 1.1)):
        other = add_object(setup.mounted_hand, setup.given_object.scale_extents(factor))
        try:
            squeeze = squeeze_object(other, grip.closing, grip.squeeze.points.mean(axis=0))
        except SceneError:
            continue  # it does not fit between the fingers, or they do not close as far
        sized = replace(
            grip, fixture=other, squeeze=squeeze, load=Load.of_all(other, grip.load.gravity)
        )
        yield _placement_row(name, sized, sized.measure_drifts(), within)


def _placement_row(name: str, grip: Grip, drifts: Sequence[Drift], within: float) -> GripPlacement:
    return GripPlacement(
        name=name,
        force=weakest_finger_force(grip.squeeze),
        speed=worst_speed(drifts),
        verdict=verdict_of(drifts, within, grip.depth_share),
    )


def _fix_rows(
    request: GripRequest, drifts: Sequence[Drift], tested_fixes: Sequence[TestedFix]
) -> tuple[GripFix, ...]:
    """Return the tested fixes: those that hold first, then by time, then by simplicity."""
    worse_speeds = 1.1  # ratio of speeds that count as worse
    speed, own = worst_speed(drifts), [drift.speeds for drift in drifts]

    def use(place: int) -> tuple[bool, float, float]:
        each = tested_fixes[place]
        holds = each.verdict(request.tolerance) == "holds"
        cost = cost_class(each.cost)
        return not holds, cost if holds else worst_speed(each.drifts), place

    fix_rows = list[GripFix]()
    scenes = SceneLoader(Path())
    for place in sorted(range(len(tested_fixes)), key=use):
        each = tested_fixes[place]
        word = each.verdict(request.tolerance)
        lines, reason = (), ""
        if each.options and [drift.speeds for drift in each.drifts] == own:
            is_solref = all(name.startswith("geom_solref") for name in each.options)
            reason = "its motion is that of the model as written, to the bit"
            reason += "; refsafe keeps time constants at twice the timestep" if is_solref else ""
        elif each.controls and not request.keyframe:
            reason = "the file has no command to close: command less, or limit the force of the "
            reason += "actuators by forcerange"
        elif word == "holds" and (each.options or each.controls) and len(fix_rows) < MOST_FIXES:
            try:
                scene = scenes.open(request.model).with_effects("all")
                with temporary_folder() as folder:
                    edits = edit_grip(request.keyframe, each.options, each.controls)
                    lines = write_model(scene, edits, Path(folder) / "changed").lines
            except SceneError as error:
                reason = str(error).splitlines()[0]
        new_speed = worst_speed(each.drifts)
        fix_rows.append(
            GripFix(
                name=each.name,
                options=dict(each.options),  # pyright: ignore[reportArgumentType] - settings
                keyframe_controls=each.controls if request.keyframe else (),
                speed=new_speed,
                verdict=word,
                worse=new_speed > worse_speeds * speed,
                time_ratio=each.time_ratio,
                lines=lines,
                no_patch_reason=reason,
            )
        )
    return tuple(fix_rows)


def edit_grip(
    keyframe: str | None, options: Mapping[str, object], controls: tuple[float, ...]
) -> ModelEdits:
    """Return the edits of a fix: its settings, and the controls of the keyframe if they change."""
    steered = ((keyframe, controls),) if keyframe and controls else ()
    return ModelEdits(options, steered=steered)


def _grip_sentence(
    setup: _Setup,
    drifts: Sequence[Drift],
    word: str,
    why: Sequence[GripCause],
    fixes: Sequence[GripFix],
) -> str:
    """Return the verdict in one sentence: speed, direction, time of loss, cause and fix."""
    worst, force = worst_drift(drifts), weakest_finger_force(setup.grip.squeeze)
    what = _object_words(setup)
    if word == "holds":
        where = f" ({worst.name})" if worst.speed > 0 else ""
        return (
            f"holds {what}: it creeps by at most {_speed_text(worst.speed)}{where}, under "
            f"{force:.3g} N per finger"
        )
    reason = f": {why[0].sentence}" if why else ""
    if not setup.grip.squeeze.is_held:
        text = f"drops {what}{reason}"
    elif word == "penetrates":
        text = f"penetrates {what}, which stays{reason}"
    elif word == "drops":
        text = f"drops {what}: lost after {worst.lost:.2g} s, {worst.name}{reason}"
    else:
        end = f", lost after {worst.lost:.3g} s" if math.isfinite(worst.lost) else ""
        speed = _speed_text(worst.speed)
        text = f"creeps: {what} moves at {speed} {worst.name}, {worst.trend}{end}{reason}"
    best = next((each for each in fixes if each.verdict == "holds"), None)
    if best is None:
        return f"{text}. No tested fix holds it" if fixes else text
    cost = f", x{best.time_ratio.ratio:.2g} time" if best.time_ratio else ""
    return f"{text}. Fix: {best.name} ({_speed_text(best.speed or 0.0)}{cost})"


def mention_worse_places(word: str, placements: Sequence[GripPlacement]) -> str:
    """Return the variants of an object that are held worse, each after a semicolon."""
    order = ("holds", "penetrates", "creeps", "drops")
    worse = [each for each in placements if order.index(each.verdict) > order.index(word)]
    return "".join(f"; {each.name}: {each.verdict}" for each in worse)


def _speed_text(speed: float) -> str:
    return f"{1e3 * speed:.3g} mm/s"
