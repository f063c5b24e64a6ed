"""Closed forms of rest: how deep soft contacts let bodies sink under their weight."""

import numpy as np

from contactlab.contact.contact_laws import rest_penetration as resting_depth
from contactlab.contact.trace_arrays import DISTANCE, FOUND, Floats, PairTrace
from contactlab.measure.context import Context
from contactlab.measure.entries import oracle
from contactlab.measure.oracle_error import gravity
from contactlab.measure.penetration import steady_by_pair

_CORNERS = 4
"""Contacts between two boxes, or a box and the floor, that meet face to face."""

_TRUNK = 10.0


@oracle(unit="m", settings=("solref", "solimp"), relative=True)
def rest_penetration(context: Context) -> tuple[Floats, Floats]:
    """Depth r at which g (1 - d(r)) dwidth^2 / (K d(r)^2) = r.

    K and d are from solref and solimp: one contact that carries a body on a fixed floor, whatever
    its mass. Holds for frictionless contacts and elliptic cones. Measured: the penetration of the
    first pair in the last step.
    """
    mass = context.setup.free_bodies[0].mass
    solref, solimp = context.setting("solref"), context.setting("solimp")
    expected = resting_depth(mass * gravity(context), 1 / mass, solref, solimp)
    return expected, -context.series[0].distance[:, -1]


@oracle(unit="m", settings=("solref", "solimp"), relative=True)
def stack_sag(context: Context) -> tuple[Floats, Floats]:
    """Depth by which the top of a stack of boxes sinks under its weight.

    Sum over the layers of the depth r at which F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, with F a
    quarter of the weight above, A = 1/m1 + 1/m2 (1/m on the floor) and K, d from solref and
    solimp. Free bodies and pairs are listed from the floor up. Measured: the sum over the pairs of
    their mean penetration in the last fifth of the run.
    """
    mass = np.stack([body.mass for body in context.setup.free_bodies], axis=1)
    carried = mass[:, ::-1].cumsum(axis=1)[:, ::-1] * gravity(context)[:, None]
    inverse = 1 / mass
    inverse[:, 1:] += 1 / mass[:, :-1]
    solref, solimp = context.setting("solref"), context.setting("solimp")
    depths = resting_depth(carried / _CORNERS, inverse, solref[:, None], solimp[:, None])
    layers = [_mean_depth(pair, context.last_fifth) for pair in context.trace.pairs]
    return depths.sum(axis=1), np.sum(layers, axis=0)


@oracle(unit="m", settings=("mass", "solref", "solimp"), relative=True)
def foot_depth(context: Context) -> tuple[Floats, Floats]:
    """Depth r at which F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, of a foot under its robot.

    F is a quarter of the weight of a foot m and a trunk M = 10 kg above it,
    A = (1/m + 2/(m + M))/3 the foot's inverse mass averaged over directions, as the engine takes
    it, and K, d are from the requested solref and solimp: a time constant below two timesteps is
    lengthened by the engine, and missed here. Measured: the metric penetration_steady.
    """
    foot = context.setting("mass")
    robot = foot + _TRUNK
    # Along the leg the foot moves alone, across it with the trunk.
    inverse = (1 / foot + 2 / robot) / 3
    solref, solimp = context.setting("solref"), context.setting("solimp")
    expected = resting_depth(robot * gravity(context) / _CORNERS, inverse, solref, solimp)
    return expected, steady_by_pair(context)[0]


def _mean_depth(pair: PairTrace, tail: slice) -> Floats:
    """Return (n,) depth [m] of a pair, averaged over its contacts and then over time."""
    depth = np.maximum(-pair.slots[:, tail, :, DISTANCE], 0).sum(axis=2)
    touching = np.minimum(pair.slots[:, tail, 0, FOUND], pair.slots.shape[2])
    return (depth / np.maximum(touching, 1)).mean(axis=1)
