"""What a trace file says: the messages of `schemas/contactlab.proto` as tables."""

from contactlab.store.mcap.wire import EnumType, Field, MessageType, Scalar

PACKAGE = "contactlab"

STEP = MessageType(
    "Step",
    (
        Field(1, "kinetic_energy", Scalar.DOUBLE),
        Field(2, "potential_energy", Scalar.DOUBLE),
        Field(3, "contacts", Scalar.FIXED32),
        Field(4, "least_distance", Scalar.DOUBLE),
        Field(5, "solver_iterations", Scalar.FIXED32),
        Field(6, "solver_iterations_most", Scalar.FIXED32),
        Field(7, "linear_momentum", Scalar.DOUBLE, repeated=True),
        Field(8, "angular_momentum", Scalar.DOUBLE, repeated=True),
    ),
)

STATE_FIELDS = (
    Field(1, "time", Scalar.DOUBLE),
    Field(2, "qpos", Scalar.DOUBLE, repeated=True),
    Field(3, "qvel", Scalar.DOUBLE, repeated=True),
)
STATE = MessageType("State", (*STATE_FIELDS, Field(4, "step", STEP)))
LAST_STATE = MessageType("State", STATE_FIELDS)

MODE = EnumType("Mode", ("NO_CONTACT", "STICK", "SLIDE"))

POINT = MessageType(
    "ContactPoint",
    (
        Field(1, "position", Scalar.FLOAT, repeated=True),
        Field(2, "normal", Scalar.FLOAT, repeated=True),
        Field(3, "tangent", Scalar.FLOAT, repeated=True),
        Field(4, "distance", Scalar.FLOAT),
        Field(5, "force", Scalar.FLOAT, repeated=True),
        Field(6, "torque", Scalar.FLOAT, repeated=True),
        Field(7, "linear_velocity", Scalar.FLOAT, repeated=True),
        Field(8, "angular_velocity", Scalar.FLOAT, repeated=True),
    ),
)

CONTACTS = MessageType(
    "Contacts",
    (
        Field(1, "count", Scalar.FIXED32),
        Field(2, "found", Scalar.FIXED32),
        Field(3, "mode", MODE),
        Field(4, "normal_force", Scalar.DOUBLE),
        Field(5, "tangential_force", Scalar.DOUBLE),
        Field(6, "friction_usage", Scalar.DOUBLE),
        Field(7, "normal_impulse", Scalar.DOUBLE),
        Field(8, "tangential_impulse", Scalar.DOUBLE),
        Field(9, "slip_speed", Scalar.DOUBLE),
        Field(10, "distance", Scalar.DOUBLE),
        Field(11, "penetration", Scalar.DOUBLE),
        Field(12, "points", POINT, repeated=True),
    ),
)
