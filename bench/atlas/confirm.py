"""Shows in plain MuJoCo what a verdict names: `python confirm.py MODEL --of ROW --body NAME`.

It needs mujoco and NumPy alone. The model rests under neutral controls for a second, then moves by
sines through its actuators, and free bodies are pushed. In windows of 40 ms it is started anew from
the run's own states with what ROW names changed, and the velocities of the body at the ends of
windows are compared, where one step of slack, both ways, forgives when an impact happens. What they
differ by, over what accelerated the body, is a share of phantom forces.

ROW is `run` (the steps, against a sixteenth of them), `gain` or `loss` (of energy, that fine steps
do not have; `energy` is either), `warning` (what MuJoCo warns of), or what is changed in the model,
at a quarter of its steps: `cone`, `impratio`, `noslip`, `solver`, `contact softness`,
`limit softness`, `friction loss softness`, `equality softness`, or `refsafe`: time constants of two
of the run's steps at least, as it has them. It ends with 0 if it is 10 % or more, else with 1.
Beside these, `limit` is the joint or tendon that goes farthest beyond its range, by half of it or
more (of what turns, an eighth of a turn counts as the least range, a quarter as the most), `depth`
the deepest contact, beyond the middle of the thinner geom, and `iterations` how far forces and
accelerations still differ where the solver used all that it may; they need no body.

`--against CHANGED` asks something else: whether a changed model is nearer than the model to what is
meant, the model at a sixteenth of its step with what ROW names changed, if that is of the model.
Windows begin where that fine motion is, and the worst body of each counts. It ends with 0 if it is.

Controls are drawn anew from a seed. `--inputs FILE.npz` replays others, from `start`, a state of
mjSTATE_INTEGRATION: `rows`, one for each step, set what the bits `spec` of mjtState name.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterator
from operator import neg
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Change = Callable[[mujoco.MjModel], None]

WINDOW, REST, DRIVEN, HELD, PUSH = 0.04, 1.0, 2.0, 0.02, (1.3, 1.35)  # s
WITHIN = 0.1
_FINEST = 16  # steps in one
_EARTH = 9.81  # m/s^2, of pushes where there is no gravity
STRAINS = ("limit", "depth")
BODILESS = ("warning", "iterations", *STRAINS)
SIGNS: dict[str, Callable[[float], float]] = {"gain": float, "loss": neg, "energy": abs}
_LEAST = 1e-3  # of the largest force: below it, one is no scale
_SOLREFS = (
    "geom_solref",
    "pair_solref",
    "jnt_solref",
    "dof_solref",
    "eq_solref",
    "tendon_solref_lim",
    "tendon_solref_fri",
)
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Case(NamedTuple):
    """What is asked: which row, of which body, from which keyframe, in whose phases."""

    row: str
    body: str
    start: str
    held: bool
    seed: int
    inputs: Path | None = None


class Found(NamedTuple):
    """Share of phantom forces on the body, and trend of energy, of one phase."""

    share: float
    energy: float
    speed: float  # mean defect of a window [m/s]


def load(path: Path) -> mujoco.MjModel:
    """Return a model; of a URDF, meshes are looked up where ROS would find them."""
    if path.suffix != ".urdf":
        return mujoco.MjModel.from_xml_path(str(path))
    text = path.read_text(encoding="utf-8")

    def found(name: re.Match[str]) -> str:
        package = re.match(r"(?:package|model)://([^/]+)/", name[2])
        if package is None:
            return f"{name[1]}{(path.parent / name[2]).resolve()}"
        above = next((p for p in path.resolve().parents if p.name == package[1]), path.parent)
        return f"{name[1]}{above / name[2][package.end() :]}"

    text = re.sub(r"""(filename\s*=\s*["'])([^"']+)""", found, text)
    if "<mujoco" not in text:
        compiler = '<mujoco><compiler strippath="false"/></mujoco>'
        text = re.sub(r"(<robot\b[^>]*>)", rf"\1{compiler}", text, count=1)
    return mujoco.MjModel.from_xml_string(text)


def gravity_of(model: mujoco.MjModel) -> float:
    """Return the magnitude of a model's gravity, 0 where it is switched off [m/s^2]."""
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    return 0.0 if off else float(np.linalg.norm(model.opt.gravity))


def _done(model: mujoco.MjModel) -> None:
    """Have the solver go on until it is done."""
    model.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    model.opt.iterations, model.opt.tolerance = max(100, model.opt.iterations), 1e-12
    model.opt.ls_iterations = max(50, model.opt.ls_iterations)


def _stiffer(*fields: str) -> Change:
    def change(model: mujoco.MjModel) -> None:
        for field in fields:
            array = getattr(model, field)
            array[:] = np.where(array[:, :1] > 0, array * [0.5, 1], array * [4, 2])

    return change


def _stiffer_equalities(model: mujoco.MjModel) -> None:
    """Halve what joins bodies, not what leads one by a mocap body."""
    bodies = model.eq_objtype == mujoco.mjtObj.mjOBJ_BODY
    ends = np.stack([model.eq_obj1id, model.eq_obj2id], axis=1) * bodies[:, None]
    leads = (model.body_mocapid[ends] >= 0).any(axis=1) & bodies
    led = model.eq_solref[leads]
    _stiffer("eq_solref")(model)
    model.eq_solref[leads] = led


def _option(**values: float) -> Change:
    def change(model: mujoco.MjModel) -> None:
        for name, value in values.items():
            setattr(model.opt, name, value)

    return change


def _impratio(model: mujoco.MjModel) -> None:
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    model.opt.impratio *= 10


def _raised(model: mujoco.MjModel) -> None:
    """Raise time constants to two of the run's steps, as refsafe has them in the run alone."""
    least = 2 * model.opt.timestep
    for field in _SOLREFS:
        array = getattr(model, field)
        array[(array[:, 0] > 0) & (array[:, 0] < least), 0] = least


CHANGES: dict[str, Change] = {
    "refsafe": _raised,
    "cone": _option(cone=int(mujoco.mjtCone.mjCONE_ELLIPTIC)),
    "impratio": _impratio,
    "noslip": _option(noslip_iterations=10, noslip_tolerance=0),
    "contact softness": _stiffer("geom_solref", "pair_solref"),
    "limit softness": _stiffer("jnt_solref", "tendon_solref_lim"),
    "friction loss softness": _stiffer("dof_solref", "tendon_solref_fri"),
    "equality softness": _stiffer_equalities,
}


def variants(path: Path, row: str) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """Return what is compared: the run itself or its reference, and the changed reference."""
    own, other = load(path), load(path)
    _done(other)
    if row in CHANGES:
        _done(own)
        if row == "impratio":
            own.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        CHANGES[row](other)
        own.opt.timestep = other.opt.timestep = own.opt.timestep / 4
    elif row != "solver":
        other.opt.timestep /= _FINEST
    return own, other


def meant(path: Path, row: str) -> mujoco.MjModel:
    """Return a model at its finest step, with what a row changes if that is of the model."""
    model = load(path)
    _done(model)
    if row in CHANGES:
        CHANGES[row](model)
    model.opt.timestep /= _FINEST
    return model


class Drive:
    """Controls and pushes of a seed, as functions of time."""

    def __init__(self, model: mujoco.MjModel, case: Case, constant: Floats) -> None:
        """Draw frequencies, phases and directions."""
        random = np.random.default_rng(case.seed)
        self._held, self._constant = case.held, constant
        self._hertz = random.uniform(0.5, 1.5, model.nu)
        self._phase = random.uniform(0, 2 * np.pi, model.nu)
        low, high = model.actuator_ctrlrange.T
        limited = model.actuator_ctrllimited > 0
        self._middle = np.where(limited, (low + high) / 2, 0.0)
        self._reach = np.where(limited, 0.35 * (high - low), 0.5)
        if not case.held and not constant.any():
            self._constant = np.where(limited, np.clip(0.0, low, high), 0.0)
        free = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        leaves = np.setdiff1d(np.flatnonzero(model.body_dofnum), model.body_parentid)
        pushed = free if free.size or model.nu else leaves
        angle = random.uniform(0, 2 * np.pi, pushed.size)
        weight = model.body_subtreemass[pushed] * (gravity_of(model) or _EARTH)
        self._push = np.zeros((model.nbody, 6))
        self._push[pushed, 0], self._push[pushed, 1] = (
            weight * np.cos(angle),
            weight * np.sin(angle),
        )

    def __call__(self, data: mujoco.MjData, time: float) -> None:
        """Set what acts from a time of the run on."""
        time = np.floor(time / HELD + 1e-9) * HELD
        sines = self._middle + self._reach * np.sin(
            2 * np.pi * self._hertz * (time - REST) + self._phase
        )
        data.ctrl[:] = self._constant if self._held or time < REST else sines
        pushed = not self._held and PUSH[0] - 1e-9 <= time < PUSH[1]
        data.xfrc_applied[:] = self._push if pushed else 0.0


class Replay:
    """Stored inputs, as a function of time."""

    def __init__(self, model: mujoco.MjModel, file: Path) -> None:
        """Read them."""
        with np.load(file) as stored:
            self.start, self._rows, self._spec = (
                stored["start"],
                stored["rows"],
                int(stored["spec"]),
            )
        self._model, self._h = model, model.opt.timestep

    def __call__(self, data: mujoco.MjData, time: float) -> None:
        """Set what acts from a time of the run on."""
        step = min(int(time / self._h + 1e-6), len(self._rows) - 1)
        if self._rows.shape[1]:
            mujoco.mj_setState(self._model, data, self._rows[step], self._spec)


def observed(model: mujoco.MjModel, data: mujoco.MjData, radius: Floats) -> tuple[Floats, float]:
    """Return (nbody, 6) velocities of centres of mass and spins times radius [m/s], energy [J]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_energyPos(model, data)
    spin = data.cvel[:, :3]
    arm = data.xipos - data.subtree_com[model.body_rootid]
    linear = data.cvel[:, 3:] + np.cross(spin, arm)
    local = np.einsum("bij,bi->bj", data.ximat.reshape(-1, 3, 3), spin)
    kinetic = (model.body_mass * (linear**2).sum(axis=1)).sum() + (
        model.body_inertia * local**2
    ).sum()
    kinetic += (model.dof_armature * data.qvel**2).sum()
    return np.hstack([linear, spin * radius[:, None]]), float(data.energy[0] + kinetic / 2)


class Side:
    """One of the two models that windows are run by, with its finer steps."""

    def __init__(self, model: mujoco.MjModel, h: float, steps: int) -> None:
        """Say of which model, against which step of the run, in how many of them a window."""
        mass = np.maximum(model.body_mass, 1e-12)
        self.radius = np.sqrt(np.maximum(model.body_inertia.max(axis=1), 0) / mass)
        self.rate = round(h / model.opt.timestep)
        self.end = steps * self.rate
        self.near = slice(self.end - self.rate, self.end + self.rate + 1)
        self.whole = slice(0, self.end + 1, self.rate)
        self._model, self._data, self._h = model, mujoco.MjData(model), h

    def run(self, state: Floats, drive: Drive | Replay) -> tuple[Floats, Floats]:
        """Run a window and one step more.

        Returns:
            (n, nbody, 6) velocities.
            (n,) energies.
        """
        data = self._data
        mujoco.mj_setState(self._model, data, state, _STATE)
        begin, seen = data.time, [observed(self._model, data, self.radius)]
        for step in range(self.end + self.rate):
            drive(data, begin + step // self.rate * self._h)
            mujoco.mj_step(self._model, data)
            seen.append(observed(self._model, data, self.radius))
        return np.array([each for each, _ in seen]), np.array([each for _, each in seen])


def _nearest(end: Floats, others: Floats) -> Floats:
    return np.linalg.norm(end - others, axis=-1).min(axis=0)


def _between(three: Floats, parts: int) -> Floats:
    place = np.linspace(0, 2, 2 * parts + 1)
    low = np.minimum(place.astype(int), 1)
    return three[low] + (place - low)[:, None, None] * (three[low + 1] - three[low])


def _parted(own: Side, mine: Floats, other: Side, fine: Floats) -> Floats:
    """Return (nbody,) how far ends of a window are apart, but for a step of slack [m/s]."""
    three = mine[[own.end - own.rate, own.end, own.end + own.rate]]
    around = _between(three, max(own.rate, other.rate))
    return np.maximum(_nearest(mine[own.end], fine[other.near]), _nearest(fine[other.end], around))


class Sums:
    """What the windows of a phase come to, for one body."""

    def __init__(self, model: mujoco.MjModel, body: int, seconds: float, radius: Floats) -> None:
        """Begin a phase, in windows of some length."""
        gravity = gravity_of(model)
        moving = model.geom_bodyid > 0
        size = max(float(model.geom_rbound.max(initial=0, where=moving)), float(radius.max()))
        self._mass, self._body = model.body_mass, body
        self._weight, self._fall = self._mass[1:].sum() * gravity * size, 0.1 * gravity * seconds
        self._parted, self._real, self._peak, self._through = 0.0, 0.0, 0.0, 0.0
        self._gains = list[float]()

    def add(self, state: Floats, drive: Drive | Replay, own: Side, other: Side) -> None:
        """Run a window by both models from a state, and compare them."""
        (mine, energy), (fine, reference) = own.run(state, drive), other.run(state, drive)
        apart = _parted(own, mine, other, fine)
        # The real forces are those of the model as it is, at its finer steps.
        path = (mine[own.whole] if own.rate > 1 else fine[other.whole])[:, self._body]
        self._real += float(np.linalg.norm(np.diff(path, axis=0), axis=-1).sum()) + self._fall
        self._real += 0.0 if self._gains else float(np.linalg.norm(path[0]))
        self._parted += float(apart[self._body])
        inside = np.clip(energy[own.end], reference[other.near].min(), reference[other.near].max())
        self._through += float(np.abs(np.diff(reference[other.whole])).sum())
        kinetic = (self._mass * (fine[other.whole] ** 2).sum(axis=-1)).sum(axis=-1) / 2
        self._peak = max(self._peak, float(kinetic.max()))
        scale = self._peak + self._through + self._weight + 1e-300
        self._gains.append(float(energy[own.end] - inside) / scale)

    def found(self) -> Found:
        """Return the shares of the phase."""
        trend, third = np.cumsum(self._gains), max(1, len(self._gains) // 3)
        energy = 1.5 * float(trend[-third:].mean() - trend[:third].mean())
        return Found(
            self._parted / (self._real + 1e-300), energy, self._parted / max(1, len(self._gains))
        )


def started(model: mujoco.MjModel, case: Case) -> tuple[mujoco.MjData, Drive | Replay]:
    """Return where a run starts, and what drives it."""
    data = mujoco.MjData(model)
    if case.inputs is not None:
        replay = Replay(model, case.inputs)
        mujoco.mj_setState(model, data, replay.start, _STATE)
        return data, replay
    if case.start != "qpos0":
        number = re.fullmatch(r"key\[(\d+)\]", case.start)  # of one without a name
        key = int(number[1]) if number else model.key(case.start).id
        mujoco.mj_resetDataKeyframe(model, data, key)
    return data, Drive(model, case, data.ctrl.copy())


def phases(path: Path, case: Case) -> Iterator[Found]:
    """Yield what each phase of the run shows."""
    model = load(path)
    data, drive = started(model, case)
    h = model.opt.timestep
    steps = max(1, round(WINDOW / h))
    own, other = (Side(each, h, steps) for each in variants(path, case.row))
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    for seconds in (REST, DRIVEN):
        sums = Sums(model, body_of(model, case.body), steps * h, own.radius)
        for _window in range(int(seconds / (steps * h) + 1e-9)):
            mujoco.mj_getState(model, data, state, _STATE)
            sums.add(state, drive, own, other)
            for _step in range(steps):
                drive(data, data.time)
                mujoco.mj_step(model, data)
        yield sums.found()


def nearer(path: Path, changed: Path, case: Case) -> tuple[bool, str]:
    """Return whether a changed model is nearer to what is meant than the model, and how near."""
    model, other, fine = load(path), load(changed), meant(path, case.row)
    if mujoco.mj_stateSize(other, _STATE) != mujoco.mj_stateSize(model, _STATE):
        return False, "it has other states"
    begun, drive = started(model, case)
    data, h = mujoco.MjData(fine), model.opt.timestep
    steps = max(1, round(WINDOW / h))
    target, *rivals = (Side(each, h, steps) for each in (fine, model, other))
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, begun, state, _STATE)
    mujoco.mj_setState(fine, data, state, _STATE)
    shares = np.zeros((2, model.nbody))
    fall = 0.1 * gravity_of(model) * steps * h
    for seconds in (REST, DRIVEN):
        parted, real = np.zeros((2, model.nbody)), np.zeros(model.nbody)
        for window in range(int(seconds / (steps * h) + 1e-9)):
            mujoco.mj_getState(fine, data, state, _STATE)
            seen = target.run(state, drive)[0]
            path_of = seen[target.whole]
            real += np.linalg.norm(np.diff(path_of, axis=0), axis=-1).sum(axis=0) + fall
            real += 0.0 if window else np.linalg.norm(path_of[0], axis=-1)
            for number, rival in enumerate(rivals):
                parted[number] += _parted(rival, rival.run(state, drive)[0], target, seen)
            begin = data.time
            for step in range(target.end):
                drive(data, begin + step // target.rate * h)
                mujoco.mj_step(fine, data)
        counted = (model.body_weldid > 0) & (model.body_mass > 1e-9 * model.body_mass.max())
        real = np.maximum(real, 1e-6 * real.max()) + 1e-300
        shares = np.maximum(shares, np.where(counted, parted / real, 0.0))
    worst = shares.argmax(axis=1)
    before, after = shares.max(axis=1)
    names = [model.body(body).name or f"body[{body}]" for body in worst]
    text = f"{100 * before:.2g} % ({names[0]}) before, {100 * after:.2g} % ({names[1]}) after"
    return bool(after < before), text


def body_of(model: mujoco.MjModel, name: str) -> int:
    """Return the number of a body, which a name such as `body[3]` has itself."""
    number = re.fullmatch(r"body\[(\d+)\]", name)
    return int(number[1]) if number else int(model.body(name).id)


def warned(path: Path, case: Case) -> list[str]:
    """Return what MuJoCo warns of in a run, and when first."""
    model = load(path)
    data, drive = started(model, case)
    for _ in range(round((REST + DRIVEN) / model.opt.timestep)):
        time = data.time
        drive(data, time)
        mujoco.mj_step(model, data)
        raised = [kind for kind in range(len(data.warning)) if data.warning[kind].number]
        if raised:
            names = [mujoco.mju_warningText(kind, data.warning[kind].lastinfo) for kind in raised]
            return [f"at {time:.3f} s: {name}" for name in names]
    return []


def strained(path: Path, case: Case) -> tuple[bool, str]:
    """Return whether a limit gives way, or a contact is deeper than a geom's middle, and which."""
    model = load(path)
    data, drive = started(model, case)
    look = _beyond if case.row == "limit" else _depths
    mujoco.mj_forward(model, data)
    before = dict(look(model, data)) if case.row == "limit" else {}
    worst, text = 0.0, "none"
    for _ in range(round((REST + DRIVEN) / model.opt.timestep)):
        drive(data, data.time)
        mujoco.mj_step(model, data)
        for name, share in look(model, data):
            more = share - before.get(name, 0.0)
            if more > worst:
                worst, text = more, f"{name}, {100 * more:.3g} %, at {data.time:.2f} s"
    return worst >= {"limit": 0.5, "depth": 1.0}[case.row], text


def _beyond(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[str, float]]:
    """Yield how far joints and tendons are beyond their ranges, as shares of what is far for them.

    That is the range; of what turns, an eighth of a turn at least, and a quarter at most.
    """
    for joint in np.flatnonzero(model.jnt_limited):
        place, (low, high) = int(model.jnt_qposadr[joint]), model.jnt_range[joint]
        at, slides = data.qpos[place], int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_SLIDE
        if int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_BALL:
            low, at = 0.0, 2 * np.arccos(min(abs(at), 1.0))
        far = high - low if slides else np.clip(high - low, np.pi / 4, np.pi / 2)
        name = model.joint(int(joint)).name or joint
        yield f"joint {name}", float(max(low - at, at - high, 0.0) / max(far, 1e-12))
    for tendon in np.flatnonzero(model.tendon_limited):
        at, (low, high) = data.ten_length[tendon], model.tendon_range[tendon]
        name = model.tendon(int(tendon)).name or tendon
        yield f"tendon {name}", float(max(low - at, at - high, 0.0) / max(high - low, 1e-12))


def _depths(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[tuple[str, float]]:
    """Yield how deep contacts are, over half of the smallest extent of the thinner geom."""
    half = model.geom_aabb[:, 3:].min(axis=1)
    for contact in data.contact:
        thin = min((half[geom] for geom in contact.geom if half[geom] > 0), default=np.inf)
        bodies = (model.body(model.geom_bodyid[geom]) for geom in contact.geom)
        names = (body.name or f"body[{body.id}]" for body in bodies)
        yield f"contact {' - '.join(names)}", float(max(0.0, -contact.dist) / thin)


def unsolved(path: Path, case: Case) -> tuple[bool, str]:
    """Return whether forces and accelerations differ where the solver used all its iterations.

    MuJoCo measures by its flag fwdinv how far; it is a share of the constraints' force there, in
    the 99th percentile of these steps.
    """
    model = load(path)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_FWDINV)
    data, drive = started(model, case)
    steps = round((REST + DRIVEN) / model.opt.timestep)
    used, gap, force = np.zeros(steps, bool), np.zeros(steps), np.zeros(steps)
    for step in range(steps):
        drive(data, data.time)
        mujoco.mj_step(model, data)
        used[step] = data.solver_niter.max(initial=0) >= model.opt.iterations
        gap[step], force[step] = data.solver_fwdinv[1], np.linalg.norm(data.qfrc_constraint)
    share = gap / np.maximum(force, _LEAST * force.max(initial=0) + 1e-300)
    worst = float(np.quantile(share[used], 0.99)) if used.any() else 0.0
    often = f"all {model.opt.iterations} iterations used in {100 * used.mean():.3g} % of the steps"
    return worst >= WITHIN, f"{often}, where forces are off by {100 * worst:.3g} %"


def shown(path: Path, case: Case) -> tuple[bool, str]:
    """Return whether plain MuJoCo shows what is asked for, and what it shows."""
    if case.row in STRAINS:
        return strained(path, case)
    if case.row == "iterations":
        return unsolved(path, case)
    if case.row == "warning":
        said = warned(path, case)
        return bool(said), "; ".join(said) or "no warning"
    found = list(phases(path, case))
    if case.row in SIGNS:
        worst = max((phase.energy for phase in found), key=SIGNS[case.row])
        return SIGNS[case.row](worst) >= WITHIN, f"energy: {100 * worst:+.3g} %"
    worst = max(found)
    text = f"{case.body}: {100 * worst.share:.2g} %, {1e3 * worst.speed:.3g} mm/s a window"
    return worst.share >= WITHIN or not np.isfinite(worst.share), text


def main() -> None:
    """Print what plain MuJoCo shows; end with 0 if it is what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("model", type=Path)
    parser.add_argument(
        "--of", default="run", choices=["run", "solver", *SIGNS, *CHANGES, *BODILESS]
    )
    parser.add_argument("--body", default="", help="which is judged")
    parser.add_argument("--start", default="qpos0", help="a keyframe, or key[NUMBER]")
    parser.add_argument("--held", action="store_true", help="keep the keyframe's controls")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--inputs", type=Path, help="controls to replay")
    parser.add_argument("--against", type=Path, help="a changed model: is it nearer?")
    asked = parser.parse_args()
    if asked.against:
        near, text = nearer(
            asked.model,
            asked.against,
            Case(asked.of, "", asked.start, asked.held, asked.seed, asked.inputs),
        )
        print(f"{'nearer' if near else 'not nearer'}: {text}")
        sys.exit(not near)
    if not asked.body and asked.of not in BODILESS:
        parser.error("name a body: --body NAME, or --body 'body[3]'")
    holds, text = shown(
        asked.model, Case(asked.of, asked.body, asked.start, asked.held, asked.seed, asked.inputs)
    )
    print(f"{'shown' if holds else 'not shown'}: {text}")
    sys.exit(not holds)


if __name__ == "__main__":
    main()
