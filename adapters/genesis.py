"""Genesis: all joints, limits, primitives and hulls in soft contact, in double precision."""

import copy
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

PACKAGE = "genesis-world"
REQUIREMENTS = ("genesis-world>=1.4.5,<1.5", "torch", "mujoco=={mujoco}", "numpy", "scipy")
_JOINTS, _CONTACTS, _POSES, _ARRIVALS = (
    SimpleNamespace(**run_path(str(Path(__file__).parent / "beside" / name)))
    for name in ("joints.py", "rigid_contacts.py", "poses.py", "arrivals.py")
)
IGNORED = (
    dict.fromkeys(("jacobian", "warmstart"), "it has a solver of its own")
    | dict.fromkeys(
        ("ccd_iterations", "ccd_tolerance", "multiccd", "nativeccd"),
        "it finds contacts its own way",
    )
    | {"refsafe": "its contacts are never faster than two steps"}
)
_OFF, _LIMIT = _JOINTS.OFF, int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
_INTEGRATORS = {
    int(mujoco.mjtIntegrator.mjINT_EULER): "Euler",
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST): "implicitfast",
}
_SOLVERS = {int(mujoco.mjtSolver.mjSOL_CG): "CG", int(mujoco.mjtSolver.mjSOL_NEWTON): "Newton"}
_ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)
_SORTS = 31  # bits of a mask
_LEAST_FRICTION = 0.01
_FASTEST = 2  # time constant of a constraint over the step
_UNDAMPED = 1e-9  # damping [1/s] that stands for none
_SMALLEST = 1e-12  # tolerance of the solver that stands for none
_EXACT = 1e-9  # of laws of contact, that numbers of the geoms are to give
_PAIRS = 150  # of geoms in contact, by default
# Ranges in which MuJoCo takes the numbers of a solimp.
_LOWEST, _HIGHEST = [1e-4, 1e-4, 1e-15, 1e-4, 1], [0.9999, 0.9999, np.inf, 0.9999, np.inf]


def refusal(model: mujoco.MjModel) -> str | None:
    """Return why it cannot simulate a model; None if it can."""
    joints, contacts = _JOINTS.refusals(model, limits=True), _CONTACTS.refusals(model)
    return next((why for applies, why in (*joints, *contacts, *_refusals(model)) if applies), None)


def _refusals(model: mujoco.MjModel) -> list[tuple[Any, str]]:
    """Return what Genesis alone cannot do."""
    opt, pairs = model.opt, _CONTACTS.pairs_of(model)
    try:
        _laws(model)
    except ValueError as error:
        return [(True, f"{error}; give geoms one friction, one solref and one solimp")]
    planes = model.geom_type == _CONTACTS.PLANE
    moves = (model.body_weldid > 0)[model.geom_bodyid]
    limited = _limited(model)
    solrefs = [*(law.solref for law in pairs.values()), *model.jnt_solref[limited]]
    safe = not opt.disableflags & _OFF.mjDSBL_REFSAFE
    return [
        (
            opt.integrator not in _INTEGRATORS,
            "it integrates by Euler or implicitfast; set integrator to one of them",
        ),
        (opt.solver not in _SOLVERS, "it has no PGS; set solver to Newton or CG"),
        (
            opt.noslip_iterations and opt.cone == _ELLIPTIC,
            "it has no noslip with elliptic cones; set noslip_iterations to 0",
        ),
        (
            opt.disableflags & _OFF.mjDSBL_EULERDAMP and model.dof_damping.any(),
            "it damps joints implicitly; leave eulerdamp on",
        ),
        ((planes & moves).any(), "its planes are fixed; take a box"),
        (
            any(law.friction < _LEAST_FRICTION for law in pairs.values()),
            f"its contacts have a friction of at least {_LEAST_FRICTION}; set condim to 3",
        ),
        (model.pair_solreffriction.any(), "it has one solref a pair; set no solreffriction"),
        (
            (model.jnt_type[limited] == _JOINTS.BALL).any(),
            "its limits are of hinges and slides; set limited to false",
        ),
        (model.jnt_margin[limited].any(), "it knows no margin of limits; set margin to 0"),
        (
            any(
                _response(each)[0] < _FASTEST * opt.timestep
                for each in solrefs
                if each[0] <= 0 or not safe
            ),
            "its constraints take at least two steps to respond; take less damping or a finer step",
        ),
        (
            model.dof_frictionloss.any() and _losses_differ(model),
            "limits and dry friction of a joint have one solref and solimp; set them alike",
        ),
        (_CONTACTS.sorts_of(model) > _SORTS, f"its masks tell {_SORTS} sorts of geoms apart"),
    ]


def _limited(model: mujoco.MjModel) -> np.ndarray:
    """Return the joints whose limits act."""
    off = model.opt.disableflags & (_OFF.mjDSBL_LIMIT | _OFF.mjDSBL_CONSTRAINT)
    return np.flatnonzero(model.jnt_limited & (not off))


def _losses_differ(model: mujoco.MjModel) -> bool:
    """Return whether dry friction responds other than the limits of its joint."""
    dofs = np.isin(model.dof_jntid, _limited(model)) & (model.dof_frictionloss > 0)
    own = np.hstack([model.dof_solref, model.dof_solimp])
    limits = np.hstack([model.jnt_solref, model.jnt_solimp])[model.dof_jntid]
    return bool((own != limits)[dofs].any())


def _response(solref: Sequence[float]) -> tuple[float, float]:
    """Return time constant [s] and damping ratio of a solref; of stiffness and damping their own.

    MuJoCo has `2 / timeconst` for a damping and `(timeconst ratio)^-2` for a stiffness.
    """
    if solref[0] > 0:
        return float(solref[0]), float(solref[1])
    timeconst = 2 / max(-float(solref[1]), _UNDAMPED)
    return timeconst, 1 / (timeconst * max(-float(solref[0]), _UNDAMPED) ** 0.5)


def _soft(solref: Sequence[float], solimp: Sequence[float]) -> np.ndarray:
    """Return (7,) how a constraint responds, as Genesis has it."""
    return np.array([*_response(solref), *np.clip(solimp, _LOWEST, _HIGHEST)])


def _laws(model: mujoco.MjModel) -> dict[int, np.ndarray]:
    """Return (10,) of each geom: frictions, whose maxima are what MuJoCo mixes, and softness.

    They are friction against sliding, torsion and rolling, and what `_soft` has, whose means are.
    A ValueError says that no numbers of the geoms give what their pairs have.
    """
    pairs = _CONTACTS.pairs_of(model)
    wanted = {
        pair: np.array([law.friction, law.torsion, law.rolling]) for pair, law in pairs.items()
    }
    geoms, matrix = _CONTACTS.incidence_of(list(pairs))
    if not geoms:
        return {}
    frictions = {
        geom: np.min([value for pair, value in wanted.items() if geom in pair], axis=0)
        for geom in geoms
    }
    soft = np.array([_soft(law.solref, law.solimp) for law in pairs.values()])
    halves, *_ = np.linalg.lstsq(matrix / 2, soft, rcond=None)
    softness = dict(zip(geoms, halves, strict=True))
    for (one, other), value, its in zip(pairs, wanted.values(), soft, strict=True):
        mixed = np.maximum(frictions[one], frictions[other])
        mean = (softness[one] + softness[other]) / 2
        near = np.abs(mean - its) <= _EXACT * np.abs(its)
        if not (near.all() and np.allclose(mixed, value, rtol=0, atol=_EXACT)):
            raise ValueError(_CONTACTS.NO_NUMBERS)
    return {geom: np.concatenate([frictions[geom], softness[geom]]) for geom in geoms}


def simulate(request: dict[str, Any], tick: Callable[[], None]) -> dict[str, Any]:
    """Simulate runs one after the other; those of one model in one world, since it forgets them."""
    import genesis

    made: dict[bytes, World] = {}

    def world_of(model: mujoco.MjModel) -> World:
        binary = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, binary)
        if (key := binary.tobytes()) not in made:
            made.clear()
            made[key] = World(model)
        return made[key]

    genesis.init(backend=genesis.cpu, precision="64", logging_level="error", seed=0)
    try:
        return _CONTACTS.simulated(request, world_of, tick)
    finally:
        made.clear()
        genesis.destroy()  # only then it keeps the kernels that it compiled for other processes


def _sent(model: mujoco.MjModel, laws: Mapping[int, np.ndarray]) -> mujoco.MjModel:
    """Return the model as Genesis is to take it, which reads a compiled one.

    Geoms have what their pairs have, and masks by which these touch and no others; springs and
    actuators act as forces, in `drive`.
    """
    sent, off = copy.copy(model), model.opt.disableflags
    sent.geom_contype[:] = sent.geom_conaffinity[:] = 0
    sent.geom_condim[:] = 6
    for geom, (own, others) in _CONTACTS.masks_of(model).items():
        sent.geom_contype[geom], sent.geom_conaffinity[geom] = own, others
        sent.geom_friction[geom] = laws[geom][:3]
        sent.geom_solref[geom], sent.geom_solimp[geom] = laws[geom][3:5], laws[geom][5:]
    limited = _limited(model)
    for joint in range(model.njnt):
        # Dry friction takes what limits have, and limits decide where there are both.
        dof = model.jnt_dofadr[joint]
        own = model.jnt_solref[joint], model.jnt_solimp[joint]
        its = own if joint in limited else (model.dof_solref[dof], model.dof_solimp[dof])
        soft = _soft(*its)
        sent.jnt_solref[joint], sent.jnt_solimp[joint] = soft[:2], soft[2:]
    sent.jnt_limited[:] = np.isin(np.arange(model.njnt), limited)
    sent.jnt_stiffness[:] = 0
    sent.actuator_ctrllimited[:] = sent.actuator_forcelimited[:] = 0
    if off & _OFF.mjDSBL_DAMPER:
        sent.dof_damping[:] = 0
    if off & (_OFF.mjDSBL_FRICTIONLOSS | _OFF.mjDSBL_CONSTRAINT):
        sent.dof_frictionloss[:] = 0
    return sent


class World:
    """A model as Genesis has it: one entity with a link for each body, in MuJoCo's order."""

    def __init__(self, model: mujoco.MjModel) -> None:
        import genesis as gs

        self._genesis, self._model, self._laws = gs, model, _laws(model)
        self._pairs = _CONTACTS.pairs_of(model)
        self._scene = gs.Scene(
            sim_options=gs.options.SimOptions(
                dt=float(model.opt.timestep), gravity=tuple(_JOINTS.gravity_of(model))
            ),
            rigid_options=self._options(),
            show_viewer=False,
        )
        hulls = dict.fromkeys(
            ("decompose_object_error_threshold", "decompose_robot_error_threshold"), np.inf
        )
        morph = gs.morphs.MJCF(
            file="<mujoco/>", align=False, default_armature=None, visualization=False,
            decimate=False, **hulls,
        )  # fmt: skip
        morph.file = _sent(model, self._laws)  # its reader takes a compiled model, not only a text
        self._entity = self._scene.add_entity(morph, name="model")
        self._scene.build()
        self._solver = self._entity.solver
        self._first = model.nbody - len(self._solver.links)  # a world without shapes is no link
        self._geoms = [
            geom
            for body in range(model.nbody)
            for geom in sorted(self._laws)
            if model.geom_bodyid[geom] == body
        ]
        self._check_arrived()

    def _options(self) -> Any:
        """Return the settings of the model; what MuJoCo has none of is as Genesis has it.

        All contacts are kept, and geoms that overlap at rest touch.
        """
        gs, opt, laws = self._genesis, self._model.opt, self._pairs.values()
        solved = laws or _limited(self._model).size or self._model.dof_frictionloss.any()
        torsion, rolling = any(law.torsion for law in laws), any(law.rolling for law in laws)
        return gs.options.RigidOptions(
            integrator=getattr(gs.integrator, _INTEGRATORS[opt.integrator]),
            constraint_solver=getattr(gs.constraint_solver, _SOLVERS[opt.solver]),
            iterations=opt.iterations,
            tolerance=max(opt.tolerance, _SMALLEST),
            ls_iterations=opt.ls_iterations,
            ls_tolerance=max(opt.ls_tolerance, _SMALLEST),
            noslip_iterations=opt.noslip_iterations,
            noslip_tolerance=max(opt.noslip_tolerance, _SMALLEST),
            friction_cone=(
                gs.friction_cone.elliptic if opt.cone == _ELLIPTIC else gs.friction_cone.pyramidal
            ),
            impratio=opt.impratio,
            constraint_timeconst=None,
            # Kernels of what there is not would take as long to compile.
            disable_constraint=not solved,
            enable_collision=bool(laws),
            enable_torsional_friction=torsion or rolling,
            enable_rolling_friction=rolling,
            enable_adjacent_collision=True,
            enable_neutral_collision=True,
            contact_pruning_tolerance=None,
            max_collision_pairs=max(_PAIRS, len(self._pairs)),
        )

    def _check_arrived(self) -> None:
        """Compare what Genesis has with the model, and step once, for which it compiles kernels."""
        model, solver, compare = self._model, self._solver, _ARRIVALS.compare
        bodies = np.flatnonzero(model.body_weldid > 0)
        names = [f"body '{model.body(body).name or body}'" for body in bodies]
        links = bodies - self._first
        compare("the mass", model.body_mass[bodies], _array(solver.get_links_mass())[links], names)
        inertia = np.array([np.diag(each) for each in model.body_inertia[bodies]])
        compare("the inertia", inertia, _array(solver.get_links_inertia())[links], names)
        self._check_contacts()
        compare(
            "the acceleration", _JOINTS.gravity_of(model), _array(solver.get_gravity()), ["gravity"]
        )
        compare("the timestep", model.opt.timestep, self._scene.dt, ["the model"])
        self._check_motion(bodies, names)

    def _check_contacts(self) -> None:
        """Compare sizes of geoms, laws of their contacts, and which of them may touch."""
        model, solver, compare = self._model, self._solver, _ARRIVALS.compare
        names = [f"geom '{model.geom(geom).name or geom}'" for geom in self._geoms]
        if len(solver.geoms) != len(names):
            raise ValueError(f"{len(names)} geoms were sent and {len(solver.geoms)} arrived")
        sizes = [
            self._size(geom, made) for geom, made in zip(self._geoms, solver.geoms, strict=True)
        ]
        compare("the size", [each[0] for each in sizes], [each[1] for each in sizes], names)
        if not names:
            return
        laws = np.array([self._laws[geom] for geom in self._geoms])
        frictions = ("friction", "friction_torsional", "friction_rolling")
        for column, name in enumerate(frictions):
            arrived = _array(getattr(solver, f"get_geoms_{name}")())
            compare(f"the {name}", laws[:, column], arrived, names)
        arrived = _array(solver.get_sol_params(geoms_idx=np.arange(len(names))))
        compare("the solref", laws[:, 3:5], arrived[:, :2], names)
        compare("the solimp", laws[:, 5:], arrived[:, 2:], names)
        told = {
            tuple(sorted((self._geoms[one], self._geoms[other])))
            for one, other in solver.collider._valid_collision_pairs
        }
        for one, other in sorted(told ^ self._pairs.keys()):
            both = " and ".join(f"geom '{model.geom(geom).name or geom}'" for geom in (one, other))
            may = "may touch, which the model filters" if (one, other) in told else "never touch"
            raise ValueError(f"{both} {may}")

    def _size(self, geom: int, made: Any) -> tuple[list[float], list[float]]:
        """Return a size (3,) as it was sent, and as it arrived; of meshes their extent."""
        kind, size = int(self._model.geom_type[geom]), self._model.geom_size[geom].tolist()
        told = [*np.ravel(made.data).tolist(), 0.0, 0.0, 0.0] if made.data is not None else []
        if kind == _CONTACTS.SPHERE:
            return [size[0], 0, 0], [told[0], 0, 0]
        if kind == _CONTACTS.BOX:
            return size, [each / 2 for each in told[:3]]
        if kind in (_CONTACTS.CAPSULE, _CONTACTS.CYLINDER):
            return [*size[:2], 0], [told[0], told[1] / 2, 0]
        if kind == _CONTACTS.MESH:
            hull = _CONTACTS.hull_of(self._model, geom)
            return np.ptp(hull, axis=0).tolist(), np.ptp(made.init_verts, axis=0).tolist()
        return [0, 0, 1], told[:3]

    def _check_motion(self, bodies: np.ndarray, names: Sequence[str]) -> None:
        """Compare places, velocities and inertia away from where joints have their zero."""
        model, solver, compare = self._model, self._solver, _ARRIVALS.compare
        data = _POSES.away_from_zero(model)
        self.set(data.qpos, data.qvel)
        sent = np.concatenate([data.qpos, data.qvel])
        scale = max(1.0, float(np.abs(data.xipos).max(initial=0)))
        compare("the state", sent, self.state(), ["the model"], scale)
        centres = _array(solver.get_links_pos(ref=self._genesis.link_ref_frame.link_COM))
        arrived = centres[bodies - self._first]
        compare("the place", data.xipos[bodies], arrived, names, scale)
        self.step()
        mujoco.mj_crb(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        told = _array(solver.get_mass_mat())
        names = [
            f"joint '{model.joint(each).name or each}', dof {dof},"
            for dof, each in enumerate(model.dof_jntid)
        ]
        compare("the inertia", inertia, np.tril(told) + np.tril(told, -1).T, names)

    def set(self, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set coordinates and velocities, and forget what ran before."""
        self._scene.reset()
        self._entity.set_qpos(qpos)
        self._entity.set_dofs_velocity(qvel)

    def drive(self, state: np.ndarray, control: np.ndarray, applied: np.ndarray) -> None:
        """Apply what acts in the next step: springs, actuators, (nbody, 6) forces on bodies."""
        model = self._model
        qpos, qvel = np.split(state, [model.nq])
        self._entity.control_dofs_force(_JOINTS.joint_forces(model, qpos, qvel, control))
        if (bodies := np.flatnonzero(applied.any(axis=1))).size:
            force, torque = np.split(applied[bodies], 2, axis=1)
            at_centre = self._genesis.link_ref_frame.link_COM
            self._solver.apply_links_external_wrench(
                force, torque, bodies - self._first, ref=at_centre
            )

    def step(self) -> None:
        """Make a step."""
        self._scene.step()

    def contacts(self) -> list[Any]:
        """Return the contacts of the step, which are of the state before it."""
        if not self._pairs:
            return []
        told = self._solver.collider.get_contacts(as_tensor=False, to_torch=False)
        # Its forces act on the second geom, its normals point to the first.
        rows = zip(
            *(told[each] for each in ("geom_b", "geom_a")),
            *(-told["force"], told["position"], told["normal"], -told["penetration"]),
            strict=True,
        )
        return [
            _CONTACTS.Contact.of(self._geoms[one], self._geoms[other], *rest)
            for one, other, *rest in rows
        ]

    def state(self) -> np.ndarray:
        """Return coordinates and velocities, as MuJoCo has them."""
        return np.concatenate(
            [_array(self._entity.get_qpos()), _array(self._entity.get_dofs_velocity())]
        )


def _array(tensor: Any) -> np.ndarray:
    return np.array(tensor.cpu(), dtype=float)
