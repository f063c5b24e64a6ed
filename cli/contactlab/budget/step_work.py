"""The work of a step of MuJoCo, counted: the same on any machine, and under any load."""

from collections.abc import Mapping

import mujoco
import numpy as np

from contactlab.contact.trace_arrays import Floats
from contactlab.scene.model_edits import FLAG_NAMES, read_flag
from contactlab.scene.unreachable import filtered_pairs

_INTEGRATORS, _SOLVERS, _GEOMS = mujoco.mjtIntegrator, mujoco.mjtSolver, mujoco.mjtGeom
_PLANE = int(_GEOMS.mjGEOM_PLANE)
_ROUND = {int(kind) for kind in (_GEOMS.mjGEOM_SPHERE, _GEOMS.mjGEOM_CAPSULE, _PLANE)}
_FIELD = 3  # kind of pairs with a height field or an SDF
_FIELDS = {int(_GEOMS.mjGEOM_HFIELD), int(_GEOMS.mjGEOM_SDF)}
_HFIELD = int(_GEOMS.mjGEOM_HFIELD)
_SDF_PRISMS = 64.0  # an SDF pair takes 16 us, the time of as many prisms of a height field
_BOX, _MESH = int(_GEOMS.mjGEOM_BOX), int(_GEOMS.mjGEOM_MESH)
_ENERGY = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
_INVERSE = int(mujoco.mjtEnableBit.mjENBL_FWDINV)
UNIT_NANOSECONDS: Mapping[str, float] = {
    "step": 708,
    "step dof": 81.2,
    "stage": 1190,
    "dof": 0,
    "body": 28.3,
    "inertia": 0,
    "actuator": 244,
    "tendon": 0,
    "sensor": 4.4,
    "energy": 5.73,
    "inverse": 17.1,
    "collision": 502,
    "collision body": 0,
    "pair": 12.4,
    "round": 0,
    "box": 113,
    "convex": 256,
    "field": 250,
    "flex": 130,
    "contact": 29.9,
    "row": 13.3,
    "entry": 0,
    "sparse": 544,
    "sparse row": 55.3,
    "island": 180,
    "island row": 16,
    "solve": 368,
    "newton": 923,
    "newton dof": 0,
    "newton entry": 2.55,
    "newton factor": 0.487,
    "newton update": 16.5,
    "search": 0,
    "search row": 2.11,
    "gradient": 181,
    "gradient dof": 2.72,
    "gradient entry": 0.565,
    "dual row": 3.59,
    "dual matrix": 0,
    "sweep": 279,
    "sweep entry": 0.677,
    "damping": 6.61,
    "fast": 123,
    "fast dof": 2.23,
    "fast factor": 8.68,
    "implicit": 172,
    "implicit dof": 85.1,
    "implicit factor": 35.1,
}
"""Time of each unit of work [ns]: fitted to measured times of 34 public robots with 25 settings,
each on one core, by `python -m bench.step_work`. Ratios of counted times to those of the model as
written are within 1.3 % of measured ones for half of these, and within 13 % for nine in ten.
Prisms of height fields are within a factor of 3, for spheres, capsules and boxes on 20 to 320 rows.
Those of islands are fitted to 36 pairs of models with and without them, up to 200 rows, and that of
flexes to four models with 60 to 768 degrees of freedom, within a factor of 2."""
UNITS = tuple(UNIT_NANOSECONDS)
UNIT_SECONDS = 1e-9 * np.array(list(UNIT_NANOSECONDS.values()))
_PLACE = {unit: place for place, unit in enumerate(UNITS)}


class StepWork:
    """Counts the work of the steps of one model.

    Attributes:
        total: (units,) work of all counted steps.
        steps: number of counted steps.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Prepare the parts of the work that no state changes."""
        self._model = model
        self.total, self.steps = np.zeros(len(UNITS)), 0
        option = model.opt
        self._stages = 4 if option.integrator == _INTEGRATORS.mjINT_RK4 else 1
        self._solver, self._enabled = int(option.solver), int(option.enableflags)
        self._islands = "island" in FLAG_NAMES and read_flag(model, "island")
        sparse_size = 60  # degrees of freedom; larger models have sparse matrices in MuJoCo
        self._is_sparse = option.jacobian == mujoco.mjtJacobian.mjJAC_SPARSE or (
            option.jacobian == mujoco.mjtJacobian.mjJAC_AUTO and model.nv >= sparse_size
        )
        self._has_contacts = float(read_flag(model, "contact") and read_flag(model, "constraint"))
        self._pairs, self._kinds = self._pair_kinds()
        self._near = np.zeros(4)

    def _pair_kinds(self) -> tuple[np.ndarray, np.ndarray]:
        model = self._model
        if not self._has_contacts:
            return np.empty((0, 2), int), np.empty(0, int)
        listed = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
        pairs = [*filtered_pairs(model), *listed]
        kinds = [_pair_kind({*model.geom_type[list(pair)].tolist()}) for pair in pairs]
        return np.array(pairs, int).reshape(-1, 2), np.array(kinds, int)

    def look_at_pairs(self, data: mujoco.MjData) -> None:
        """Count the pairs of geoms that come near enough for a look at their shapes."""
        if not len(self._pairs):
            return
        model, (first, second) = self._model, self._pairs.T
        reach = model.geom_rbound + model.geom_margin
        far = np.linalg.norm(data.geom_xpos[first] - data.geom_xpos[second], axis=1)
        near = far <= reach[first] + reach[second]
        for plane, other in ((first, second), (second, first)):
            rows = model.geom_type[plane] == _PLANE
            normal = data.geom_xmat[plane][:, 2::3]
            way = data.geom_xpos[other] - data.geom_xpos[plane]
            height = np.einsum("ij,ij->i", normal, way)
            near = np.where(rows, height <= reach[other], near)
        weights = np.ones(len(near))
        for pair in np.flatnonzero(near & (self._kinds == _FIELD)):
            weights[pair] = self._count_prisms(data, *self._pairs[pair].tolist())
        self._near = np.bincount(self._kinds[near], weights[near], minlength=4)

    def _count_prisms(self, data: mujoco.MjData, first: int, second: int) -> float:
        # The prisms of a height field below the sphere around the other geom.
        model = self._model
        if model.geom_type[first] != _HFIELD:
            first, second = second, first
        if model.geom_type[first] != _HFIELD:
            return _SDF_PRISMS
        field, turn = int(model.geom_dataid[first]), data.geom_xmat[first].reshape(3, 3)
        *half, top, bottom = model.hfield_size[field].tolist()
        *place, height = turn.T @ (data.geom_xpos[second] - data.geom_xpos[first])
        reach = float(model.geom_rbound[second] + model.geom_margin[second])
        if not -bottom - reach < height < top + reach:
            return 0.0
        prisms = 2.0  # per cell
        counts = int(model.hfield_ncol[field]), int(model.hfield_nrow[field])
        for middle, end, count in zip(place, half, counts, strict=True):
            covered = min(middle + reach, end) - max(middle - reach, -end)
            prisms *= max(0.0, 1 + covered * (count - 1) / (2 * end)) if covered > 0 else 0.0
        return prisms

    def count_step(self, data: mujoco.MjData) -> None:
        """Add the work of the step that ended in a state."""
        model, row = self._model, np.zeros(len(UNITS))
        awake = float(data.nv_awake) if read_flag(model, "sleep") else float(model.nv)
        share = awake / max(model.nv, 1)

        def add_parts(**parts: float) -> None:
            for name, amount in parts.items():
                row[_PLACE[name.replace("_", " ")]] += amount

        multi = 5.0 if "multiccd" in FLAG_NAMES and read_flag(model, "multiccd") else 1.0
        touching = min(1.0, float(data.ncon) / max(self._near.sum(), 1.0))
        add_parts(
            stage=1,
            dof=awake,
            body=share * model.nbody,
            inertia=share * model.nM,
            collision=self._has_contacts,
            collision_body=self._has_contacts * share * model.nbody,
            pair=share * len(self._pairs),
            round=self._near[0],
            box=self._near[1],
            convex=self._near[2] * (1 + (multi - 1) * touching),
            field=self._near[3],
            # A contact of a flex moves the vertices of an element.
            flex=(model.nflexelem + model.nflexvert + 5 * data.ncon) if model.nflex else 0.0,
            contact=data.ncon,
            row=data.nefc,
            entry=data.nJ if self._is_sparse else data.nefc * awake,
            actuator=model.nu,
            tendon=model.ntendon,
            sensor=model.nsensor,
            energy=(model.nbody + awake) if self._enabled & _ENERGY else 0.0,
            inverse=(1 + awake + data.nefc) if self._enabled & _INVERSE else 0.0,
        )
        if data.nefc:
            add_parts(**self._solver_parts(data, awake))
            if self._is_sparse:
                add_parts(sparse=1, sparse_row=data.nefc)
            if self._islands:
                add_parts(island=max(1, data.nisland), island_row=data.nefc + awake)
        row *= self._stages
        add_parts(step=1, step_dof=awake, **self._integrator_parts(share, awake))
        self.total += row
        self.steps += 1

    def _integrator_parts(self, share: float, awake: float) -> dict[str, float]:
        model, integrator = self._model, self._model.opt.integrator
        inertia = share * model.nM
        if integrator == _INTEGRATORS.mjINT_EULER:
            damped = read_flag(model, "eulerdamp") and bool(model.dof_damping.any())
            return {"damping": inertia if damped else 0.0}
        if integrator == _INTEGRATORS.mjINT_IMPLICITFAST:
            return {"fast": 1, "fast_dof": awake + model.nu, "fast_factor": inertia}
        if integrator == _INTEGRATORS.mjINT_IMPLICIT:
            size = share * (model.nbody + model.nu)
            return {"implicit": 1, "implicit_dof": size, "implicit_factor": share * model.nD}
        return {}

    def count_steps(
        self, data: mujoco.MjData, steps: int, inputs: Floats | None, spec: int
    ) -> None:
        """Make steps with inputs (steps, width), and count all except the first."""
        for step in range(steps):
            if inputs is not None:
                mujoco.mj_setState(self._model, data, inputs[step], spec)
            mujoco.mj_step(self._model, data)
            if step == 1:
                self.look_at_pairs(data)
            if step:
                self.count_step(data)

    def _solver_parts(self, data: mujoco.MjData, awake: float) -> dict[str, float]:
        found = dict.fromkeys((unit for unit in UNITS), 0.0)
        rows, size = float(data.nefc), awake
        entries = float(data.nJ) if self._is_sparse else rows * size
        islands = max(1, min(int(data.nisland), len(data.solver_niter)) if self._islands else 1)
        found["solve"] = islands
        counts = data.solver_niter[:islands].tolist()
        per_island = len(data.solver) // len(data.solver_niter)
        for island, count in enumerate(counts):
            part = 1 / islands
            first = island * per_island
            searches, updates, sweeps = 0.0, 0.0, 0.0
            read = 0 if self._solver == _SOLVERS.mjSOL_PGS else min(count, per_island)
            for place in range(first, first + read):
                stat = data.solver[place]
                searches += stat.neval
                updates += stat.nupdate
                sweeps += stat.neval == 0
            main = count
            if self._solver == _SOLVERS.mjSOL_NEWTON:
                main = count - sweeps
                found["newton"] += main
                found["newton dof"] += main * size * part
                found["newton entry"] += main * entries * part
                found["newton factor"] += (1 + main) * (size * part) ** 2
                found["newton update"] += updates * size * part
            elif self._solver == _SOLVERS.mjSOL_CG:
                main = count - sweeps
                found["gradient"] += main
                found["gradient dof"] += main * (size + self._model.nM) * part
                found["gradient entry"] += main * entries * part
            found["search"] += searches
            found["search row"] += searches * rows * part
            if self._solver == _SOLVERS.mjSOL_PGS or sweeps:
                found["dual row"] += rows * size * part
                found["dual matrix"] += (rows * part) ** 2
            done = count if self._solver == _SOLVERS.mjSOL_PGS else sweeps
            found["sweep"] += done
            found["sweep entry"] += done * (rows * part) ** 2
        return {name.replace(" ", "_"): value for name, value in found.items() if value}


def _pair_kind(kinds: set[int]) -> int:
    if kinds & _FIELDS:
        return _FIELD
    if kinds <= _ROUND or (_PLANE in kinds and _MESH not in kinds):
        return 0
    return 1 if kinds <= {*_ROUND, _BOX} else 2
