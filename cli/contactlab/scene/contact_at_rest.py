"""Contacts by what they are at rest: the solref of each pair that the law of rest asks for.

At rest, depth r of a contact carries F with ``r = s F A (1 - d) dwidth^2 / (K d^2)``: d is the
impedance at r, A = 1/m1 + 1/m2 as the engine has it, and s what a pyramidal cone makes of the load.
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
from contactlab.scene.contact_pairs import (
    MonitoredPair,
    colliding,
    effective_parameters,
    explicit_pair,
    may_touch,
    mixing_weight,
)
from contactlab.scene.keyframes import start_data
from contactlab.scene.model_names import name_of
from contactlab.schema.evidence import PairRecord

_NEAR = 1e-3  # gap of what counts as touching where loads are found [m]
_LOADED = 1e-6  # share of the greatest load from which a contact bears one
_MICROMETRE = 1e-6
_EXACT = 1e-9


@dataclass(frozen=True)
class ContactAtRest:
    """Inputs of the law of rest for a pair, besides its load."""

    name: str
    solref: tuple[float, ...]
    solimp: tuple[float, ...]
    inverse_mass: float  # of both sides [1/kg], as the engine has it
    softness: float  # what its friction cone multiplies its load by
    radius: float  # of the smaller geom [m]

    def solref_of(self, depth: float, load: float, zeta: float) -> tuple[float, float]:
        """Return the solref of a damping ratio with which a load [N] makes it so deep [m].

        In standard form. A SceneError says that the geom is not as thick, or nothing is damped.
        """
        if depth >= self.radius:
            raise SceneError(
                f"{self.name}: {depth * 1e3:.3g} mm is deeper than the smaller geom, which "
                f"reaches {self.radius * 1e3:.3g} mm"
            )
        if not 0 < zeta < np.inf:
            raise SceneError(
                f"{self.name}: solref has no damping ratio above 0, so that it never comes to rest"
            )
        weight = self.softness * load
        rate = float(stiffness_at_rest(depth, weight, self.inverse_mass, self.solimp)) ** 0.5
        return 1 / (zeta * rate), zeta


def law_of_rest(model: mujoco.MjModel, pair: MonitoredPair, used: PairRecord) -> ContactAtRest:
    """Return what the law of rest takes of a pair of effective parameters, of a run's model."""
    geoms = [side[0] for side in pair.geoms]
    inverse = float(model.body_invweight0[model.geom_bodyid[geoms], 0].sum())
    softness, cone = 1.0, model.opt.cone
    if cone == mujoco.mjtCone.mjCONE_PYRAMIDAL:
        softness = pyramid_softness(used.friction[0], used.condim, model.opt.impratio)
    reach = model.geom_rbound[geoms]
    radius = float(np.where(reach > 0, reach, np.inf).min())
    return ContactAtRest(pair.name, used.solref, used.solimp, inverse, softness, radius)


def write_at_rest(
    model: mujoco.MjModel, pairs: Sequence[MonitoredPair], name: str, size: float, keyframe: str
) -> None:
    """Write a stiffness [N/m] or a depth at rest [m] of every monitored pair into a model.

    Damping ratios stay. For a stiffness, the impedance becomes constant, so that contacts are
    linear springs; for a depth, loads are those where a keyframe, or qpos0, is held still, and
    pairs that bear none there are left as they are.
    A SceneError says of which pair it has no meaning, or that the timestep is too long for it.
    """
    touch, deep = may_touch(model), name == "depth_at_rest"
    loads = _loads(model, keyframe) if deep else {}
    rows = dict[tuple[int, int], Floats]()
    for pair in pairs:
        every = colliding(touch, pair)
        borne = [load for geoms in every for load in loads.get(frozenset(geoms), ())]
        if not (borne if deep else every):
            continue
        law = law_of_rest(model, pair, effective_parameters(model, pair))
        if not deep:  # of any load: that of a micrometre, with constant impedance
            law = replace(law, solimp=(law.solimp[1], *law.solimp[1:]))
        depth, load = (size, float(np.mean(borne))) if deep else (_MICROMETRE, size * _MICROMETRE)
        solref = law.solref_of(depth, load, float(damping_ratio(law.solref)))
        if model.opt.timestep > (1 + _EXACT) * largest_step(solref):
            raise SceneError(
                f"{pair.name}: {name} {size:g} {AT_REST[name]} takes a timestep of at most "
                f"{largest_step(solref):.3g} s; it is {model.opt.timestep:g} s"
            )
        rows |= dict.fromkeys(every, np.array([*solref, *law.solimp]))
    if not rows:
        raise SceneError(
            f"no pair bears a load where the model is written, so that {name} has no meaning; "
            "give a stiffness, or a keyframe at rest"
        )
    _write(model, rows)


def _loads(model: mujoco.MjModel, keyframe: str) -> dict[frozenset[int], list[float]]:
    """Return the loads [N] of the contacts of each two geoms where the model is held still.

    Contacts without spring and damping, of the hardest impedance, leave no acceleration: their
    forces are those of rest, wherever the solver's least ones are as good as any.
    """
    rigid = copy.copy(model)
    rigid.geom_solref[:] = rigid.pair_solref[:] = 0
    rigid.geom_solimp[:, :2] = rigid.pair_solimp[:, :2] = IMPEDANCE_RANGE[1]
    rigid.geom_margin += _NEAR / 2
    rigid.pair_margin += _NEAR
    mujoco.mj_setConst(rigid, mujoco.MjData(rigid))
    data, force = start_data(rigid, keyframe), np.zeros(6)
    data.qvel[:] = 0
    mujoco.mj_forward(rigid, data)
    loads = dict[frozenset[int], list[float]]()
    for index, geoms in enumerate(data.contact.geom.tolist()):
        mujoco.mj_contactForce(rigid, data, index, force)
        loads.setdefault(frozenset(geoms), []).append(float(force[0]))
    least = _LOADED * max((load for shares in loads.values() for load in shares), default=0.0)
    return {
        geoms: kept for geoms, load in loads.items() if (kept := [x for x in load if x > least])
    }


def _write(model: mujoco.MjModel, rows: Mapping[tuple[int, int], Floats]) -> None:
    """Write solref and solimp (7,) of pairs of geoms, so that they mix to what each should have.

    A SceneError says that geoms in several pairs cannot have both.
    """
    mixed = {geoms: want for geoms, want in rows.items() if explicit_pair(model, *geoms) is None}
    for geoms in rows.keys() - mixed.keys():
        index = explicit_pair(model, *geoms)
        model.pair_solref[index], model.pair_solimp[index] = np.split(rows[geoms], [2])
    if not mixed:
        return
    ids = np.unique(list(mixed))
    weights, wanted = np.zeros((len(mixed), len(ids))), np.array(list(mixed.values()))
    for row, (first, second) in enumerate(mixed):
        share = mixing_weight(model, first, second)
        weights[row] = share * (ids == first) + (1 - share) * (ids == second)
    # The values nearest to the mean of what each geom's pairs should have.
    used = weights > 0
    mean = used.T @ wanted / np.maximum(used.sum(axis=0), 1)[:, None]
    values = mean + np.linalg.pinv(weights) @ (wanted - weights @ mean)
    apart = ~np.isclose(weights @ values, wanted, rtol=_EXACT, atol=0).all(axis=1)
    if apart.any() or (values[used.any(axis=0)] <= 0)[:, :2].any():
        first, second = (name_of(model, "geom", geom) for geom in [*mixed][int(apart.argmax())])
        raise SceneError(
            f"{first}-{second}: its geoms are in other pairs too, and no solref of geoms mixes to "
            "what each pair takes; name only the `pairs` that count in a scene, or write "
            f'<contact><pair geom1="{first}" geom2="{second}"/></contact> into the model'
        )
    for place, geom in enumerate(ids.tolist()):
        if used[:, place].any():
            model.geom_solref[geom], model.geom_solimp[geom] = np.split(values[place], [2])
