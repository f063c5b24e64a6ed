"""Sets contacts by their behavior at rest: computes the solref of each pair from the law of rest.

At rest, depth r of a contact carries F with ``r = s F A (1 - d) dwidth^2 / (K d^2)``. d is the
impedance at r, A = 1/m1 + 1/m2 as the engine computes it, and s the factor of a pyramidal cone on
the load.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from contactlab.contact.contact_laws import (
    IMPEDANCE_RANGE,
    damping_ratio,
    largest_step,
    pyramid_softness,
    stiffness_at_rest,
)
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError
from contactlab.mjcf import AT_REST
from contactlab.numerical_tolerance import COARSE_ROUNDING, SUM_ROUNDING
from contactlab.scene.contact_pairs import (
    MonitoredPair,
    colliding_geoms,
    effective_parameters,
    explicit_pair,
    mixing_weight,
)
from contactlab.scene.keyframes import start_data
from contactlab.scene.model_names import name_of
from contactlab.schema.evidence import PairRecord


@dataclass(frozen=True)
class ContactAtRest:
    """Inputs of the law of rest for a pair, except its load."""

    name: str
    solref: tuple[float, ...]
    solimp: tuple[float, ...]
    inverse_mass: float  # sum of both sides [1/kg], as the engine computes it
    softness: float  # factor of the friction cone on the load
    radius: float  # radius of the smaller geom [m]

    def solref_for_depth(self, depth: float, load: float, zeta: float) -> tuple[float, float]:
        """Return the solref that lets a load [N] reach a depth [m] at a damping ratio.

        It is in standard form. A SceneError says that the depth exceeds the geom, or that there is
        no damping.
        """
        if depth >= self.radius:
            raise SceneError(
                f"{self.name}: {depth * 1e3:.3g} mm is deeper than the smaller geom, which "
                f"reaches {self.radius * 1e3:.3g} mm"
            )
        if not 0 < zeta < np.inf:
            raise SceneError(
                f"{self.name}: the damping ratio of solref is not above 0, so the contact never "
                "comes to rest; write a damping ratio such as 1"
            )
        weight = self.softness * load
        rate = float(stiffness_at_rest(depth, weight, self.inverse_mass, self.solimp)) ** 0.5
        return 1 / (zeta * rate), zeta


def rest_law_inputs(
    model: mujoco.MjModel, pair: MonitoredPair, parameters: PairRecord
) -> ContactAtRest:
    """Return the inputs of the law of rest for a pair of a run's model."""
    geoms = [side[0] for side in pair.geoms]
    inverse = float(model.body_invweight0[model.geom_bodyid[geoms], 0].sum())
    softness, cone = 1.0, model.opt.cone
    if cone == mujoco.mjtCone.mjCONE_PYRAMIDAL:
        softness = pyramid_softness(parameters.friction[0], parameters.condim, model.opt.impratio)
    reach = model.geom_rbound[geoms]
    radius = float(np.where(reach > 0, reach, np.inf).min())
    return ContactAtRest(pair.name, parameters.solref, parameters.solimp, inverse, softness, radius)


def write_at_rest(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], name: str, size: float, keyframe: str
) -> None:
    """Write a stiffness [N/m] or a depth at rest [m] of every monitored pair into a model.

    Damping ratios are unchanged. For a stiffness, the impedance becomes constant, so that contacts
    are linear springs. For a depth, loads are computed with the model held still at a keyframe or
    at qpos0, and pairs without a load there are left unchanged.

    A SceneError names the pair if the value has no meaning for it or the timestep is too long.
    """
    deep = name == "depth_at_rest"
    loads = _loads_at_rest(model, keyframe) if deep else {}
    rows = dict[tuple[int, int], Floats]()
    micrometre = 1e-6  # in place of no depth: a contact of a stiffness needs some
    for pair, every in zip(pairs, colliding_geoms(model, pairs), strict=True):
        carried = [load for geoms in every for load in loads.get(frozenset(geoms), ())]
        if not (carried if deep else every):
            continue
        law = rest_law_inputs(model, pair, effective_parameters(model, pair))
        if not deep:  # the load does not matter: take that of 1 micrometer, at constant impedance
            law = replace(law, solimp=(law.solimp[1], *law.solimp[1:]))
        depth, load = (size, float(np.mean(carried))) if deep else (micrometre, size * micrometre)
        solref = law.solref_for_depth(depth, load, float(damping_ratio(law.solref)))
        if model.opt.timestep > (1 + SUM_ROUNDING) * largest_step(solref):
            raise SceneError(
                f"{pair.name}: {name} {size:g} {AT_REST[name]} needs a timestep of at most "
                f"{largest_step(solref):.3g} s; it is {model.opt.timestep:g} s"
            )
        rows |= dict.fromkeys(every, np.array([*solref, *law.solimp]))
    if not rows:
        raise SceneError(
            f"no pair carries a load at the start of the model, so {name} has no meaning; "
            "write a stiffness, or start from a keyframe at rest"
        )
    _write_pair_parameters(model, rows)


def _loads_at_rest(model: mujoco.MjModel, keyframe: str) -> dict[frozenset[int], list[float]]:
    """Return the contact loads [N] of each two geoms when the model is held still.

    Contacts without spring and damping, at the hardest impedance, leave no acceleration. Their
    forces are the forces at rest, wherever the least-norm forces of the solver are as good as any.
    """
    rigid = copy.copy(model)
    rigid.geom_solref[:] = rigid.pair_solref[:] = 0
    rigid.geom_solimp[:, :2] = rigid.pair_solimp[:, :2] = IMPEDANCE_RANGE[1]
    touching_gap_m = 1e-3  # geoms with a smaller gap count as touching
    rigid.geom_margin += touching_gap_m / 2
    rigid.pair_margin += touching_gap_m
    mujoco.mj_setConst(rigid, mujoco.MjData(rigid))
    data, force = start_data(rigid, keyframe), np.zeros(6)
    data.qvel[:] = 0
    mujoco.mj_forward(rigid, data)
    loads = dict[frozenset[int], list[float]]()
    for index, geoms in enumerate(data.contact.geom.tolist()):
        mujoco.mj_contactForce(rigid, data, index, force)
        loads.setdefault(frozenset(geoms), []).append(float(force[0]))
    least = COARSE_ROUNDING * max(
        (load for shares in loads.values() for load in shares), default=0.0
    )
    return {
        geoms: large_loads
        for geoms, load in loads.items()
        if (large_loads := [x for x in load if x > least])
    }


def _write_pair_parameters(model: mujoco.MjModel, rows: Mapping[tuple[int, int], Floats]) -> None:
    """Write solref and solimp (7,) of geom pairs, so that they mix to the intended values.

    A SceneError reports geoms in several pairs that cannot have the values of both.
    """
    mixed = {geoms: want for geoms, want in rows.items() if explicit_pair(model, *geoms) is None}
    for geoms in rows.keys() - mixed.keys():
        index = explicit_pair(model, *geoms)
        model.pair_solref[index], model.pair_solimp[index] = np.split(rows[geoms], [2])
    if not mixed:
        return
    ids = np.unique(list(mixed))
    weights, mixed_values = np.zeros((len(mixed), len(ids))), np.array(list(mixed.values()))
    for row, (first, second) in enumerate(mixed):
        share = mixing_weight(model, first, second)
        weights[row] = share * (ids == first) + (1 - share) * (ids == second)
    # The values nearest to the mean over the intended values of each geom's pairs.
    is_used = weights > 0
    mean = is_used.T @ mixed_values / np.maximum(is_used.sum(axis=0), 1)[:, None]
    values = mean + np.linalg.pinv(weights) @ (mixed_values - weights @ mean)
    apart = ~np.isclose(weights @ values, mixed_values, rtol=SUM_ROUNDING, atol=0).all(axis=1)
    if apart.any() or (values[is_used.any(axis=0)] <= 0)[:, :2].any():
        first, second = (name_of(model, "geom", geom) for geom in [*mixed][int(apart.argmax())])
        raise SceneError(
            f"{first}-{second}: its geoms are in other pairs too, and no solref of the geoms gives "
            "each pair its value; list only the relevant `pairs` in a scene, or write "
            f'<contact><pair geom1="{first}" geom2="{second}"/></contact> into the model'
        )
    for place, geom in enumerate(ids.tolist()):
        if is_used[:, place].any():
            model.geom_solref[geom], model.geom_solimp[geom] = np.split(values[place], [2])
