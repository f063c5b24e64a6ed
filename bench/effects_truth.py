"""Claims of `contactlab effects`, in plain MuJoCo: under other pushes, tilts and controls.

Run: python -m bench.effects_truth FOLDER MODEL [OPTION...]

The folder has, or gets, the study of the model; options are as `--duration 0.5s`. Each line is
tried in loops of `mj_step` from the start of the task, with controls, pushes and a tilt that the
study did not have. A part that is called unused has to leave each bit of the motion unchanged. A
part below the tolerance may change the motion by at most the tolerance, in windows of 40 ms, and a
needed part has to change it by more than half of the tolerance under one of these loads, under four
stronger ones, or without any. An actuator that is called needed has to move a joint. The smaller
model has to take the time that is reported, within 7 %.
"""

import copy
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from contactlab.parts import register_parts
from contactlab.schema.effects_report import REPORT, EffectsReport, PartEffect

WINDOW, WEIGHT = 0.04, 0.1
TURNS, SECONDS = 7, 0.25
CLAIMED = 0.07
LOADS = 6
_HELD = 10  # steps with the same controls
_STRONG = 2.5  # times the steps of a load that is needed to show a part

Change = Callable[[mujoco.MjModel], None]


def time_models(
    models: Sequence[mujoco.MjModel], key: int = -1, seconds: float = SECONDS
) -> list[float]:
    """Return the times of models over that of the first: medians of turns in plain loops.

    Runs begin at a keyframe, or at the default pose, and simulate so many seconds.
    """
    taken = np.array([[_time_loop(model, key, seconds) for model in models] for _ in range(TURNS)])
    return [float(np.median(taken[:, place] / taken[:, 0])) for place in range(1, len(models))]


def _time_loop(model: mujoco.MjModel, key: int, seconds: float) -> float:
    data, rng = mujoco.MjData(model), np.random.default_rng(5)
    if key >= 0:
        mujoco.mj_resetDataKeyframe(model, data, key)
    phases = rng.uniform(0, 6, model.nu)
    steps = max(20, round(seconds / model.opt.timestep))
    middle, half = _control_ranges(model)
    begin = time.thread_time()
    for _ in range(0, steps, _HELD):
        data.ctrl[:] = middle + 0.3 * half * np.sin(4 * data.time + phases)
        for _ in range(_HELD):
            mujoco.mj_step(model, data)
    return time.thread_time() - begin


def _control_ranges(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    ranges = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, [-1.0, 1.0])
    return ranges.mean(axis=1), np.ptp(ranges, axis=1) / 2


@dataclass(frozen=True)
class Load:
    """A tilt [deg], the share of controls, and of the weight that pushes each body.

    Controls are held for a period [s], if it is not 0.
    """

    tilt: float
    azimuth: float
    drive: float
    push: float
    seed: int
    period: float = 0.0

    def tilt_gravity(self, model: mujoco.MjModel) -> None:
        """Tilt gravity, in place."""
        size = float(np.linalg.norm(model.opt.gravity))
        lean, turn = np.radians(self.tilt), np.radians(self.azimuth)
        side = np.sin(lean) * np.array([np.cos(turn), np.sin(turn)])
        model.opt.gravity[:] = size * np.array([*side, -np.cos(lean)])


def draw_loads(count: int) -> list[Load]:
    """Return loads that no study has."""
    rng = np.random.default_rng(42)
    return [
        Load(
            float(rng.uniform(0, 18)),
            float(rng.uniform(0, 360)),
            float(rng.uniform(0.2, 1.0)),
            float(rng.uniform(0, 0.5)),
            seed,
        )
        for seed in range(count)
    ]


def strong_loads() -> list[Load]:
    """Return loads that show parts which only much force needs."""
    passive = Load(0.0, 0.0, 0.0, 0.0, 99)
    turns = range(4)
    return [passive, *(Load(20.0, 90.0 * one, 4.0, 0.5 * one, 100 + one, 0.07) for one in turns)]


class Runner:
    """Runs a model under a load from a start."""

    def __init__(self, model: mujoco.MjModel, load: Load, key: int) -> None:
        self.model = copy.copy(model)
        load.tilt_gravity(self.model)
        self.data, self._load = mujoco.MjData(self.model), load
        rng = np.random.default_rng(load.seed)
        self._phases = rng.uniform(0, 6, model.nu)
        self._rates = rng.uniform(2, 9, model.nu)
        self._pushed = rng.normal(size=(model.nbody, 3))
        if key >= 0:
            mujoco.mj_resetDataKeyframe(self.model, self.data, key)
        self._begin = self.data.ctrl.copy()

    def step(self) -> None:
        """Make a step."""
        data, load = self.data, self._load
        middle, half = _control_ranges(self.model)
        time = data.time // load.period * load.period if load.period else data.time
        drive = 0.5 * load.drive * half * np.sin(self._rates * time + self._phases)
        ends = middle - half, middle + half
        wanted = self._begin + drive
        # Only strong controls exceed the limits.
        data.ctrl[:] = wanted if load.drive > 1 else np.clip(wanted, *ends)
        pushes = load.push * 9.81 * self.model.body_mass[:, None] * self._pushed
        data.xfrc_applied[:, :3] = pushes if data.time % 0.5 < 0.1 else 0.0
        mujoco.mj_step(self.model, data)

    def velocities(self) -> np.ndarray:
        """Return (B, 3) velocities of centers of mass."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)
        spin, along = self.data.cvel[:, :3], self.data.cvel[:, 3:]
        arm = self.data.xipos - self.data.subtree_com[self.model.body_rootid]
        return along + np.cross(spin, arm)


def find_differences(
    model: mujoco.MjModel, changed: mujoco.MjModel, load: Load, key: int, steps: int
) -> tuple[bool, float]:
    """Return whether each bit of a motion is unchanged, and the share of forces that differs."""
    whole, without = Runner(model, load, key), Runner(changed, load, key)
    kind, same = mujoco.mjtState.mjSTATE_INTEGRATION, True
    state = np.empty(mujoco.mj_stateSize(model, kind))
    window = max(2, round(WINDOW / model.opt.timestep))
    apart, real = np.zeros(model.nbody), np.zeros(model.nbody)
    for _ in range(0, steps, window):
        mujoco.mj_getState(whole.model, whole.data, state, kind)
        mujoco.mj_setState(without.model, without.data, state, kind)
        speed = whole.velocities()
        for _ in range(window):
            whole.step()
            without.step()
            now = whole.velocities()
            real += np.linalg.norm(now - speed, axis=1)
            speed = now
        same &= bool((whole.data.qpos == without.data.qpos).all())
        apart += np.linalg.norm(speed - without.velocities(), axis=1)
        real += WEIGHT * 9.81 * WINDOW
    moving = (model.body_weldid > 0) & (model.body_mass > 1e-6 * model.body_mass[1:].max())
    return same, float((apart / real)[moving].max(initial=0.0))


def build_without(file: Path, model: mujoco.MjModel, part: PartEffect) -> mujoco.MjModel | None:
    """Return a model without a part; None if it is not known how to leave it out."""
    bodies = [pair.split(" - ") for pair in part.members or (part.name,)]
    if part.kind == "pair" and all(len(pair) == 2 for pair in bodies):
        spec = mujoco.MjSpec.from_file(str(file))
        for first, second in bodies:
            spec.add_exclude(bodyname1=first, bodyname2=second)
        return spec.compile()
    change = leave_out(model, part)
    if change is None:
        return None
    changed = copy.copy(model)
    change(changed)
    return changed


def leave_out(model: mujoco.MjModel, part: PartEffect) -> Change | None:  # noqa: C901 - a table
    """Return the change that leaves a part out, written by hand; None if it is not known."""
    disabled = mujoco.mjtDisableBit
    flags = {
        "contact": disabled.mjDSBL_CONTACT, "damper": disabled.mjDSBL_DAMPER,
        "spring": disabled.mjDSBL_SPRING, "limit": disabled.mjDSBL_LIMIT,
        "frictionloss": disabled.mjDSBL_FRICTIONLOSS, "equality": disabled.mjDSBL_EQUALITY,
        "gravity": disabled.mjDSBL_GRAVITY, "clampctrl": disabled.mjDSBL_CLAMPCTRL,
        "warmstart": disabled.mjDSBL_WARMSTART, "refsafe": disabled.mjDSBL_REFSAFE,
        "eulerdamp": disabled.mjDSBL_EULERDAMP, "island": disabled.mjDSBL_ISLAND,
        "multiccd": disabled.mjDSBL_MULTICCD, "nativeccd": disabled.mjDSBL_NATIVECCD,
        "midphase": disabled.mjDSBL_MIDPHASE,
    }  # fmt: skip
    enabled = mujoco.mjtEnableBit
    switches = {"energy": enabled.mjENBL_ENERGY, "fwdinv": enabled.mjENBL_FWDINV,
                "sleep": enabled.mjENBL_SLEEP}  # fmt: skip
    options = {
        "noslip": {"noslip_iterations": 0}, "impratio": {"impratio": 1.0},
        "elliptic": {"cone": 0}, "air": {"density": 0.0, "viscosity": 0.0},
        "implicit": {"integrator": 0},
    }  # fmt: skip
    fields = {"armature": ("dof_armature",), "gravity compensation": ("body_gravcomp",),
              "margin": ("geom_margin", "geom_gap", "pair_margin", "pair_gap")}  # fmt: skip
    bounds = {"tangential_friction": 1, "torsional_friction": 3, "rolling_friction": 4}
    ids = _find_ids(model, part)

    def change_feature(made: mujoco.MjModel) -> None:
        made.opt.disableflags |= int(flags.get(part.name, 0))
        made.opt.enableflags ^= int(switches.get(part.name, 0))
        if part.adds:  # sleep needs islands
            made.opt.disableflags &= ~int(disabled.mjDSBL_ISLAND)
        for name, value in options.get(part.name, {}).items():
            setattr(made.opt, name, value)
        for name in fields.get(part.name, ()):
            getattr(made, name)[:] = 0
        if part.name == "armature":  # the stiffness of contacts is scaled by it when compiled
            mujoco.mj_setConst(made, mujoco.MjData(made))
        if part.name in bounds:
            for name in ("geom_condim", "pair_dim"):
                array = getattr(made, name)
                array[:] = np.minimum(array, bounds[part.name])

    def change_part(made: mujoco.MjModel) -> None:
        match part.kind:
            case "geom":
                made.geom_contype[ids] = made.geom_conaffinity[ids] = 0
                gone = np.isin(made.pair_geom1, ids) | np.isin(made.pair_geom2, ids)
                made.pair_margin[gone] = -1e6
            case "pair":
                made.pair_margin[ids] = -1e6
            case "limit":
                made.jnt_limited[ids] = 0
            case "tendon":
                for name in ("stiffness", "damping", "frictionloss", "limited"):
                    getattr(made, f"tendon_{name}")[ids] = 0
            case "sensor":
                made.opt.disableflags |= int(disabled.mjDSBL_SENSOR)
            case "actuator":
                made.actuator_gainprm[ids] = made.actuator_biasprm[ids] = 0
            case _:
                pass

    if part.kind == "feature":
        return (
            change_feature if part.name in {*flags, *switches, *options, *fields, *bounds} else None
        )
    return change_part if len(ids) or part.name == "sensors" else None


def _find_ids(model: mujoco.MjModel, part: PartEffect) -> np.ndarray:
    objects = {"limit": "joint"}
    kind = objects.get(part.kind, part.kind)
    if kind not in ("geom", "pair", "joint", "tendon", "actuator"):
        return np.empty(0, int)
    names = [getattr(model, kind)(place).name for place in range(getattr(model, _SIZES[kind]))]
    names = [name or f"{kind}[{place}]" for place, name in enumerate(names)]
    wanted = part.members or (part.name,)
    found = [names.index(name) for name in wanted if name in names]
    bodies = [name for name in wanted if name not in names]
    if kind == "geom" and bodies:  # a geom without a name goes by that of its body
        for geom in range(model.ngeom):
            own = int(model.geom_bodyid[geom])
            body = model.body(own).name or f"body[{own}]"
            if body in bodies or f"{body} geom[{geom}]" in bodies:
                found.append(geom)
    return np.array(found, int)


_SIZES = {"geom": "ngeom", "pair": "npair", "joint": "njnt", "tendon": "ntendon", "actuator": "nu"}


def check_claims(file: Path, report: EffectsReport) -> Iterator[tuple[str, str]]:
    """Yield a verdict of each claim, and a line on it."""
    model = mujoco.MjModel.from_xml_path(str(file))
    key = _find_start(model, report)
    steps = round(0.8 / model.opt.timestep)
    for part in report.effects:
        if part.verdict in ("not exercised", "not measured", "near the tolerance"):
            continue
        changed = build_without(file, model, part)
        if changed is None:
            yield "skipped", f"{part.kind} {part.name}: {part.verdict}"
            continue
        found = [find_differences(model, changed, load, key, steps) for load in draw_loads(LOADS)]
        share = max(each for _, each in found)
        if part.verdict == "unused":
            right = all(same for same, _ in found) or (part.kind == "feature" and share < 1e-6)
        elif part.verdict == "below the tolerance":
            right = share <= report.tolerance
        else:
            if share <= 0.5 * report.tolerance:
                strong = [
                    find_differences(model, changed, load, key, round(_STRONG * steps))
                    for load in strong_loads()
                ]
                found, share = [*found, *strong], max(share, *(each for _, each in strong))
            right = share > 0.5 * report.tolerance or (
                part.kind == "actuator" and not all(same for same, _ in found)
            )
        said = "" if part.error is None else f" {part.error:.2%}"
        line = f"{part.kind} {part.name}: {part.verdict}{said}, in plain MuJoCo {share:.2%}"
        yield "confirmed" if right else "WRONG", line


def _find_start(model: mujoco.MjModel, report: EffectsReport) -> int:
    names = [model.key(number).name or f"key[{number}]" for number in range(model.nkey)]
    return names.index(report.task.start) if report.task.start in names else -1


def check_saving(file: Path, report: EffectsReport, folder: Path) -> str:
    """Return a line on the time of the smaller model."""
    if report.smaller is None:
        return report.sentence
    paths = [file, folder / report.smaller.file]
    models = [mujoco.MjModel.from_xml_path(str(path)) for path in paths]
    (ratio,) = time_models(models, _find_start(models[0], report), report.task.duration)
    said = report.smaller.time_ratio.ratio
    word = "confirmed" if abs(ratio / said - 1) <= CLAIMED else "WRONG"
    return f"{word} saving: x{said:.3f} reported, x{ratio:.3f} in plain MuJoCo"


def main() -> None:
    """Study a model, and try each claim."""
    register_parts()
    folder, file, options = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]
    if not (folder / REPORT).is_file():
        from contactlab.command_line.main import command_line  # noqa: PLC0415 - it takes a while

        words = ["effects", str(file), "-o", str(folder), "--format", "json", *options]
        command_line()(words, standalone_mode=False)
    report = EffectsReport.model_validate_json((folder / REPORT).read_text())
    count = Counter[str]()
    for word, line in check_claims(file, report):
        count[word] += 1
        if word != "confirmed":
            print(f"{word}: {line}", flush=True)
    print(f"{file.stem}: {dict(count)}; {check_saving(file, report, folder)}", flush=True)


if __name__ == "__main__":
    main()
