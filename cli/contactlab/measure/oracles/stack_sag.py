"""How far the top of a stack of boxes sinks under its weight."""

import numpy as np

from contactlab.contact import DISTANCE, FOUND, Floats, PairTrace, rest_penetration
from contactlab.measure.context import Context
from contactlab.measure.oracles.oracle import Oracle, setting

CORNERS = 4
"""Contacts between two boxes, or a box and the floor, that meet face to face."""


def _stack_sag(context: Context) -> tuple[Floats, Floats]:
    layers = [_mean_depth(pair, context.tail) for pair in context.trace.pairs]
    return _expected(context), np.sum(layers, axis=0)


def _expected(context: Context) -> Floats:
    mass = np.stack([body.mass for body in context.setup.free_bodies], axis=1)
    gravity = np.linalg.norm(context.setup.gravity, axis=1, keepdims=True)
    carried = mass[:, ::-1].cumsum(axis=1)[:, ::-1] * gravity
    inverse = 1 / mass
    inverse[:, 1:] += 1 / mass[:, :-1]
    solref, solimp = setting(context, "solref"), setting(context, "solimp")
    depths = rest_penetration(carried / CORNERS, inverse, solref[:, None], solimp[:, None])
    return depths.sum(axis=1)


def _mean_depth(pair: PairTrace, tail: slice) -> Floats:
    """Return (n,) depth [m] of a pair, averaged over its contacts and then over time."""
    depth = np.maximum(-pair.slots[:, tail, :, DISTANCE], 0).sum(axis=2)
    touching = np.minimum(pair.slots[:, tail, 0, FOUND], pair.slots.shape[2])
    return (depth / np.maximum(touching, 1)).mean(axis=1)


STACK_SAG = Oracle(
    name="stack_sag",
    unit="m",
    relative=True,
    definition=(
        "Sum over the layers of the depth r at which F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, "
        "with F a quarter of the weight above, A = 1/m1 + 1/m2 (1/m on the floor) and K, d from "
        "solref and solimp. Free bodies and pairs are listed from the floor up. Measured: the sum "
        "over the pairs of their mean contact depth in the last fifth."
    ),
    settings=("solref", "solimp"),
    function=_stack_sag,
)
