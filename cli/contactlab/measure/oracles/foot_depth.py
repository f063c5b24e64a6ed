"""How deep a foot stands in the ground under the robot that it carries."""

from contactlab.contact import Floats, rest_penetration
from contactlab.measure.context import Context
from contactlab.measure.oracles.motion import fall
from contactlab.measure.oracles.oracle import Oracle, setting
from contactlab.measure.oracles.stack_sag import CORNERS
from contactlab.measure.penetration import steady_by_pair

_TRUNK = 10.0


def _foot_depth(context: Context) -> tuple[Floats, Floats]:
    foot = setting(context, "mass")
    robot = foot + _TRUNK
    # Along the leg the foot moves alone, across it with the trunk.
    inverse = (1 / foot + 2 / robot) / 3
    solref, solimp = setting(context, "solref"), setting(context, "solimp")
    expected = rest_penetration(robot * fall(context) / CORNERS, inverse, solref, solimp)
    return expected, steady_by_pair(context)[0]


FOOT_DEPTH = Oracle(
    name="foot_depth",
    unit="m",
    relative=True,
    definition=(
        "The depth r at which F A (1 - d(r)) dwidth^2 / (K d(r)^2) = r, with F a quarter of the "
        "weight of a foot m and a trunk M = 10 kg above it, A = (1/m + 2/(m + M))/3 the foot's "
        "inverse mass averaged over directions, as the engine takes it, and K, d from solref and "
        "solimp as asked for: a time constant below two timesteps is lengthened by the engine, "
        "and missed here. Measured: the metric penetration_steady."
    ),
    settings=("mass", "solref", "solimp"),
    function=_foot_depth,
)
