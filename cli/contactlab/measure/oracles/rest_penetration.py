"""How deep a single contact lets a body sink under its weight."""

from contactlab.contact import Floats, rest_penetration
from contactlab.measure.context import Context
from contactlab.measure.oracles.motion import fall
from contactlab.measure.oracles.oracle import Oracle, setting


def _rest_penetration(context: Context) -> tuple[Floats, Floats]:
    mass = context.setup.free_bodies[0].mass
    solref, solimp = setting(context, "solref"), setting(context, "solimp")
    expected = rest_penetration(mass * fall(context), 1 / mass, solref, solimp)
    return expected, -context.series[0].distance[:, -1]


REST_PENETRATION = Oracle(
    name="rest_penetration",
    unit="m",
    relative=True,
    definition=(
        "The depth r at which g (1 - d(r)) dwidth^2 / (K d(r)^2) = r, with K and d from solref "
        "and solimp: one contact that carries a body on a fixed floor, whatever its mass. Holds "
        "for frictionless contacts and elliptic cones. Measured: the depth of the first pair in "
        "the last step."
    ),
    settings=("solref", "solimp"),
    function=_rest_penetration,
)
