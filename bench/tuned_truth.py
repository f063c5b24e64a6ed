"""Compare models that `tune` wrote with the originals, in plain loops of MuJoCo.

Run: python -m bench.tuned_truth FOLDER ...
     python -m bench.tuned_truth hold GRIPPER.xml SCENE.xml
     python -m bench.tuned_truth pair ORIGINAL.xml CHANGED.xml [KEYFRAME]

A folder is the output of `contactlab tune MODEL -o FOLDER`; each of its written models is judged.
`pair` judges any two files. A model whose bodies close on each other is a gripper: it closes on a
box, or on the body that its keyframe holds, and creep, pull-out force and depth are compared. Of
any other model each actuator makes a step and then a sine of 1 Hz, alone, and its error is compared
against the original at a sixteenth of its step. `hold` writes a scene of a gripper that
holds a box in its keyframe `held`.

Nothing here is computed by contactlab.
"""

import copy
import itertools
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile

import mujoco
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
WIDTH = 0.02
"""m, of the box in a grip; a narrower gripper gets a box of half its opening."""
CLOSE_SECONDS, HOLD_SECONDS, PULL_SECONDS = 0.6, 1.5, 1.5
PULL_FORCE = 40.0
"""N, at the end of the pull: above the force of any gripper here, times its friction."""
SLIPPED = 2e-3
"""m: an object that moved as far under a pull is out of its place."""
OPENING = 0.012
"""m: a gripper opens by more."""
DROPPED = 0.05
"""m/s: an object that creeps faster is not held."""
HEAVY = 1e6
"""Factor of the mass of a box that fingers do not move. A box whose state is reset after each step
would be as soft as it is light, and deeper at a longer step."""
CLEARANCE = 1e-3
"""m: how near fingers are to the box when they begin to close."""
FINE = 16
SHARE = 0.1
"""Share of a control's range: the step, and the amplitude of the sine."""
TOLERANCE = 0.05
CREEP_FLOOR, FORCE_FLOOR, DEPTH_FLOOR, TRACKING_FLOOR = 1e-5, 0.02, 1e-5, 1e-3
"""m/s, N and m, and the share of an actuator's excursion: below, two values are equal."""


@dataclass(frozen=True)
class Grip:
    """A gripper on a box: the commands of its actuators, and the box's place.

    Attributes:
        opened: controls that open it.
        closed: controls that close it.
        center: middle of the box, of width `width`, between the fingers.
        axes: rotation matrix; the first column is the direction of the fingers.
        width: of the box [m].
        geoms: of the fingers.
    """

    opened: Floats
    closed: Floats
    center: Floats
    axes: Floats
    width: float
    geoms: tuple[int, int]


@dataclass(frozen=True)
class Measure:
    """One quantity of both models."""

    name: str
    unit: str
    before: float
    after: float
    floor: float
    more_is_better: bool = False

    @property
    def worse(self) -> bool:
        """Whether the changed model is worse by more than the tolerance."""
        gain = self.before - self.after
        loss = gain if self.more_is_better else -gain
        return not loss <= max(self.floor, TOLERANCE * abs(self.before))


def run_for(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    seconds: float,
    each_step: Callable[[float], None] = lambda _: None,
) -> None:
    """Step for some simulated time; `each_step` gets the time since the begin, before each step."""
    for step in range(round(seconds / model.opt.timestep)):
        each_step(step * model.opt.timestep)
        mujoco.mj_step(model, data)


def control_ranges(model: mujoco.MjModel) -> Floats:
    """Return (nu, 2) ranges of controls; without one, the range of the joint or -1 to 1."""
    ranges = np.tile([-1.0, 1.0], (model.nu, 1))
    for actuator in range(model.nu):
        joint = model.actuator_trnid[actuator, 0]
        if model.actuator_ctrllimited[actuator]:
            ranges[actuator] = model.actuator_ctrlrange[actuator]
        elif model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT and (
            model.jnt_limited[joint] and model.actuator_biastype[actuator]
        ):
            ranges[actuator] = model.jnt_range[joint]
    return ranges


def find_grip(file: str) -> Grip | None:
    """Return the grip of a gripper that holds a box best; None if nothing closes or holds.

    The fingers are the two geoms that come nearer to each other by most. The box is placed between
    their nearest points, or between their middles.
    """
    model = mujoco.MjModel.from_xml_path(file)
    if not 0 < model.nu <= 12:
        return None
    choices = list_commands(model)
    settled = [settle_weightless(model, controls) for controls in choices]
    best, opening = None, OPENING
    pairs = _finger_pairs(model, settled[0])
    for first, second in itertools.permutations(range(len(choices)), 2):
        for geoms in pairs:
            apart, _ = measure_distance(model, settled[first], geoms)
            near, _ = measure_distance(model, settled[second], geoms)
            if near < apart / 3 and apart - near > opening:
                opening, best = apart - near, (choices[first], choices[second], geoms)
    if best is None:
        return None
    opened, closed, geoms = best
    held = list[tuple[float, Grip]]()
    for grip in _place_boxes(model, geoms, (opened, closed), opening):
        boxed = with_box(file, grip).compile()
        creep, force, _ = measure_hold(
            boxed, close_on_box(boxed, grip), boxed.body("gripped_box").id
        )
        if force > 0 and creep < DROPPED:
            held.append((creep, grip))
    return min(held, key=lambda each: each[0], default=(0.0, None))[1]


def reset_to_start(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the state of the first keyframe, or of qpos0."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


def list_commands(model: mujoco.MjModel) -> list[Floats]:
    """Return controls that may open or close fingers.

    Up to four actuators are at both ends of their ranges. Of more, one alone or all together.
    """
    ranges = control_ranges(model)
    if model.nu <= 4:
        ends = itertools.product((0, 1), repeat=model.nu)
        return [ranges[np.arange(model.nu), each] for each in map(list, ends)]
    rest = reset_to_start(model).ctrl
    moved = [np.where(np.arange(model.nu) == one, 1, 0) for one in range(model.nu - 2, model.nu)]
    moved += [moved[0] + moved[1], np.ones(model.nu, int)]
    return [np.where(each, ranges[:, end], rest) for each in moved for end in (0, 1)]


def approach_box(
    model: mujoco.MjModel, controls: tuple[Floats, Floats], geoms: tuple[int, int], width: float
) -> mujoco.MjData:
    """Return the state in which fingers that close are as far apart as a box is wide."""
    fingers, free = settle_weightless(model, controls[0]), make_weightless(model)
    fingers.ctrl[:] = controls[1]
    begin = fingers.time
    while measure_distance(model, fingers, geoms)[0] > width + CLEARANCE:
        if fingers.time > begin + 4 * CLOSE_SECONDS:
            break
        mujoco.mj_step(free, fingers)
    return fingers


def make_weightless(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a model without gravity and contacts."""
    weightless = copy.copy(model)
    weightless.opt.gravity[:] = 0
    weightless.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return weightless


def settle_weightless(model: mujoco.MjModel, controls: Floats) -> mujoco.MjData:
    """Return the state that controls lead to without gravity and contacts.

    Some fingers rub on their hand so much that they need minutes to open.
    """
    weightless = make_weightless(model)
    data = reset_to_start(weightless)
    data.ctrl[:] = controls
    run_for(weightless, data, 2 * CLOSE_SECONDS)
    return data


def measure_distance(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: tuple[int, int]
) -> tuple[float, Floats]:
    """Return the distance of two geoms, and the middle between their nearest points."""
    ends = np.zeros(6)
    distance = mujoco.mj_geomDistance(model, data, *geoms, 1.0, ends)
    return distance, (ends[:3] + ends[3:]) / 2


def _finger_pairs(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[int, int]]:
    # Geoms that collide with others, of which neither body carries the other.
    geoms = [
        geom
        for geom in range(model.ngeom)
        if _moves(model, geom) and model.geom_contype[geom] | model.geom_conaffinity[geom]
    ]

    def carriers(geom: int) -> set[int]:
        body, found = int(model.geom_bodyid[geom]), set[int]()
        while body:
            found.add(int(model.body_weldid[body]))
            body = int(model.body_parentid[body])
        return found

    def own(geom: int) -> int:
        return int(model.body_weldid[model.geom_bodyid[geom]])

    return [
        (first, second)
        for first, second in itertools.combinations(geoms, 2)
        if own(first) not in carriers(second)
        and own(second) not in carriers(first)
        and np.linalg.norm(data.geom_xpos[first] - data.geom_xpos[second]) < 0.2
    ]


def _place_boxes(
    model: mujoco.MjModel,
    geoms: tuple[int, int],
    controls: tuple[Floats, Floats],
    opening: float,
) -> Iterator[Grip]:
    width = min(WIDTH, opening / 2)
    data = approach_box(model, controls, geoms, width)
    middles = data.geom_xpos[list(geoms)]
    ends = np.zeros(6)
    mujoco.mj_geomDistance(model, data, *geoms, 1.0, ends)
    across = ends[3:] - ends[:3]
    across /= np.linalg.norm(across)
    other = np.cross(across, [0.0, 0.0, 1.0])
    if np.linalg.norm(other) < 0.5:
        other = np.cross(across, [0.0, 1.0, 0.0])
    other /= np.linalg.norm(other)
    axes = np.stack([across, other, np.cross(across, other)], axis=1)
    near = (ends[:3] + ends[3:]) / 2
    for center in (near, middles.mean(axis=0), (near + middles.mean(axis=0)) / 2):
        yield Grip(*controls, center, axes, width, geoms)


def _moves(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.body_weldid[model.geom_bodyid[geom]])


def with_box(file: str, grip: Grip) -> mujoco.MjSpec:
    """Return a model with a free box between its fingers."""
    spec = mujoco.MjSpec.from_file(file)
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, grip.axes.ravel())
    box = spec.worldbody.add_body(name="gripped_box", pos=grip.center.tolist(), quat=quat.tolist())
    box.add_freejoint()
    for key in spec.keys:
        key.qpos = [*key.qpos, *grip.center, *quat]
    half = grip.width / 2
    box.add_geom(
        name="gripped_box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[half, half, half], mass=0.05
    )
    return spec


def close_on_box(model: mujoco.MjModel, grip: Grip) -> mujoco.MjData:
    """Return the state with the gripper closed on its box, without gravity.

    The box is first too heavy to be moved, and then itself.
    """
    gravity = model.opt.gravity.copy()
    model.opt.gravity[:] = 0
    data = reset_to_start(model)
    box = model.body("gripped_box").id
    heavy = copy.copy(model)
    heavy.body_mass[box] *= HEAVY
    heavy.body_inertia[box] *= HEAVY
    mujoco.mj_setConst(heavy, mujoco.MjData(heavy))
    place = int(model.jnt_qposadr[model.body_jntadr[box]])
    fingers = approach_box(model, (grip.opened, grip.closed), grip.geoms, grip.width)
    data.qpos[:], data.act[:], data.ctrl[:] = fingers.qpos, fingers.act, grip.closed
    data.qpos[place : place + 7] = model.qpos0[place : place + 7]
    run_for(heavy, data, 2 * CLOSE_SECONDS)
    run_for(model, data, CLOSE_SECONDS / 2)
    model.opt.gravity[:] = gravity
    return data


def measure_hold(
    model: mujoco.MjModel, data: mujoco.MjData, body: int
) -> tuple[float, float, float]:
    """Return creep [m/s], pull-out force [N] and greatest depth [m] of a held body.

    It hangs for a while; its creep is the speed over the second half, in the frame of the body
    that it touches. Then a force grows, down and to the side, until it slips.
    """
    holders = [
        {int(model.geom_bodyid[geom]) for geom in contact.geom.tolist()} - {body}
        for contact in data.contact[: data.ncon]
        if body in model.geom_bodyid[contact.geom]
    ]
    if not holders:
        return np.inf, 0.0, np.inf
    holder = min(holders[0])
    depths, ways = list[float](), list[Floats]()

    def see(_: float) -> None:
        depths.extend(
            -contact.dist
            for contact in data.contact[: data.ncon]
            if body in model.geom_bodyid[contact.geom]
        )
        ways.append(_relative_place(data, body, holder))

    run_for(model, data, HOLD_SECONDS, see)
    half = len(ways) // 2
    creep = float(np.linalg.norm(ways[-1] - ways[half])) / (HOLD_SECONDS / 2)
    start, force = _relative_place(data, body, holder), [PULL_FORCE]
    pulled = data.xfrc_applied[body]
    gravity = model.opt.gravity / max(np.linalg.norm(model.opt.gravity), 1e-9)

    def pull(time: float) -> None:
        if np.linalg.norm(_relative_place(data, body, holder) - start) > SLIPPED:
            force[0] = min(force[0], PULL_FORCE * time / PULL_SECONDS)
        pulled[:3] = gravity * PULL_FORCE * time / PULL_SECONDS

    run_for(model, data, PULL_SECONDS, pull)
    return creep, force[0], max(depths, default=0.0)


def _relative_place(data: mujoco.MjData, body: int, holder: int) -> Floats:
    return data.xmat[holder].reshape(3, 3).T @ (data.xpos[body] - data.xpos[holder])


def find_held_body(model: mujoco.MjModel, keyframe: str) -> int | None:
    """Return the lightest free body that touches another moving body in a keyframe."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    mujoco.mj_forward(model, data)
    bodies = {
        int(model.geom_bodyid[geom])
        for contact in data.contact[: data.ncon]
        if all(_moves(model, each) for each in contact.geom)
        for geom in contact.geom
    }
    free = [
        body
        for body in bodies
        if model.body_jntnum[body] and model.jnt_type[model.body_jntadr[body]] == 0
    ]
    return min(free, key=lambda body: model.body_subtreemass[body], default=None)


def compare_grips(before: str, after: str, keyframe: str | None) -> list[Measure]:
    """Return the measures of a grip; none if the model is no gripper."""
    model = mujoco.MjModel.from_xml_path(before)
    body = find_held_body(model, keyframe) if keyframe else None
    values = list[tuple[float, float, float]]()
    if keyframe and body is not None:
        for file in (before, after):
            held = mujoco.MjModel.from_xml_path(file)
            data = mujoco.MjData(held)
            mujoco.mj_resetDataKeyframe(held, data, held.key(keyframe).id)
            mujoco.mj_forward(held, data)
            values.append(measure_hold(held, data, body))
    else:
        grip = find_grip(before)
        if grip is None:
            return []
        for file in (before, after):
            held = with_box(file, grip).compile()
            values.append(measure_hold(held, close_on_box(held, grip), held.body("gripped_box").id))
    (creep, force, depth), (creep2, force2, depth2) = values
    return [
        Measure("creep", "mm/s", 1e3 * creep, 1e3 * creep2, 1e3 * CREEP_FLOOR),
        Measure("force", "N", force, force2, FORCE_FLOOR, more_is_better=True),
        Measure("depth", "mm", 1e3 * depth, 1e3 * depth2, 1e3 * DEPTH_FLOOR),
    ]


def track_actuator(
    model: mujoco.MjModel, keyframe: str | None, actuator: int, wave: str, times: Floats
) -> Floats:
    """Return the lengths of an actuator that moves alone, at some times."""
    data = mujoco.MjData(model)
    if keyframe is not None:
        mujoco.mj_resetDataKeyframe(model, data, model.key(keyframe).id)
    low, high = control_ranges(model)[actuator]
    rest = data.ctrl[actuator]
    size = SHARE * (high - low) * (1 if rest < (low + high) / 2 else -1)
    lengths, own = list[float](), list[float]()

    def drive(time: float) -> None:
        data.ctrl[actuator] = rest + size * (1 if wave == "step" else np.sin(2 * np.pi * time))
        # After a step of RK4 the length is that of its last stage.
        for update in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon):
            update(model, data)
        mujoco.mj_transmission(model, data)
        own.append(data.time)
        lengths.append(float(data.actuator_length[actuator]))

    run_for(model, data, 1.0 + model.opt.timestep, drive)
    return np.interp(times, np.array(own) - own[0], lengths)


def compare_tracking(before: str, after: str, keyframe: str | None) -> tuple[list[Measure], int]:
    """Return tracking errors of each actuator, and the number of motions without a reference.

    A motion has a reference if a further half of its step changes less than half of the error.
    """
    models = [mujoco.MjModel.from_xml_path(file) for file in (before, after)]
    fine = [mujoco.MjModel.from_xml_path(before) for _ in range(2)]
    for model, rate in zip(fine, (FINE, 2 * FINE), strict=True):
        model.opt.timestep /= rate
    found, chaotic = list[Measure](), 0
    times = np.linspace(0.0, 1.0 - max(model.opt.timestep for model in models), 101)
    chosen = np.unique(np.linspace(0, models[0].nu - 1, min(models[0].nu, 8)).astype(int))
    for actuator, wave in itertools.product(chosen.tolist(), ("step", "sine")):
        ways = [
            track_actuator(model, keyframe, actuator, wave, times) for model in (*models, *fine)
        ]
        excursion = max(float(np.ptp(ways[3])), 1e-9)
        own, other, left = (
            float(np.sqrt(np.mean((way - ways[3]) ** 2))) for way in (*ways[:2], ways[2])
        )
        if not left <= max(own / 2, TRACKING_FLOOR * excursion):
            chaotic += 1
            continue
        floor = max(TRACKING_FLOOR * excursion, 2 * left)
        name = f"{models[0].actuator(actuator).name or actuator} {wave}"
        found.append(Measure(name, "", own, other, floor))
    return found, chaotic


def judge_pair(name: str, before: str, after: str, keyframe: str | None) -> bool:
    """Print the measures of two models; return whether none is worse."""
    if measures := compare_grips(before, after, keyframe):
        text = ", ".join(f"{each.name} {_values_text(each)}" for each in measures)
    else:
        measures, chaotic = compare_tracking(before, after, keyframe)
        worst = max(measures, key=lambda each: each.after - each.before, default=None)
        text = f"{len(measures)} errors" + (
            f"; {worst.name} {_values_text(worst)}" if worst else ""
        )
        text += f"; {chaotic} without a reference" if chaotic else ""
    worse = [each for each in measures if each.worse]
    print(f"{'WORSE' if worse else 'ok   '} {name}: {text}", flush=True)
    for each in worse[:4]:
        print(f"      worse: {each.name} {_values_text(each)}", flush=True)
    return not worse


def _values_text(measure: Measure) -> str:
    return f"{measure.before:.3g} -> {measure.after:.3g} {measure.unit}".rstrip()


def judge_folder(folder: Path) -> bool:
    """Judge each model that `tune` wrote; return whether none is worse."""
    report = json.loads((folder / "tune.json").read_text())
    start = report["task"]["start"]
    keyframe = start.get("keyframe") if isinstance(start, dict) else start
    keyframe = None if keyframe in (None, "qpos0") else keyframe
    files = [report["file"], (report.get("equal_error") or {}).get("file")]
    good = True
    for file in files:
        if file:
            name = f"{folder.name} ({Path(file).parent.name})"
            good &= judge_pair(name, report["model"], str(folder / file), keyframe)
    if not any(files):
        print(f"same  {folder.name}: no change recommended", flush=True)
    return good


def write_held_scene(gripper: str, scene: Path) -> None:
    """Write a scene of a gripper that holds a box, with the keyframe `held`."""
    grip = find_grip(gripper)
    if grip is None:
        raise SystemExit(f"{gripper} does not close on anything")
    spec = with_box(gripper, grip)
    model = spec.compile()
    data = close_on_box(model, grip)
    run_for(model, data, CLOSE_SECONDS)
    spec.add_key(
        name="held",
        qpos=data.qpos.tolist(),
        qvel=[0.0] * model.nv,
        ctrl=data.ctrl.tolist(),
        act=data.act.tolist(),
    )
    folder = str(Path(gripper).resolve().parent / spec.meshdir)
    spec.meshdir = spec.texturedir = folder
    spec.compile()
    files = [asset.file for asset in (*spec.meshes, *spec.textures) if asset.file]
    for file in files:
        copied = scene.parent / "assets" / file
        copied.parent.mkdir(parents=True, exist_ok=True)
        copyfile(Path(folder) / file, copied)
    scene.write_text(spec.to_xml().replace(f'"{folder}', '"assets'))


def main(words: Sequence[str]) -> None:
    """Judge folders or a pair of files, or write a scene."""
    if words[0] == "hold":
        write_held_scene(words[1], Path(words[2]))
    elif words[0] == "pair":
        keyframe = words[3] if len(words) > 3 else None
        judge_pair(Path(words[1]).stem, words[1], words[2], keyframe)
    else:
        good = [judge_folder(Path(folder)) for folder in words]
        print(f"{sum(good)} of {len(good)} no worse")


if __name__ == "__main__":
    main(sys.argv[1:])
