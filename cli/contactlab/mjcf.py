"""The MJCF attributes of settings; imports no engine.

Source: MuJoCo's XML reference (option, geom, pair).
"""

DISTANCE_FIELDS = ("sdf_iterations", "sdf_initpoints")
"""Options of signed distance fields: a run has them as settings if they are not MuJoCo's own."""

OPTIONS = (
    *("timestep", "tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance", "impratio"),
    *("density", "viscosity", "iterations", "ls_iterations", "noslip_iterations"),
    *("ccd_iterations", "gravity", "wind", "integrator", "cone", "solver", "jacobian"),
    *DISTANCE_FIELDS,
)
"""Attributes of <option>."""

MODEL_ENGINE = "mujoco"  # engine of models, and of sweeps that name no engine

CONTACT = ("solref", "solimp", "friction", "condim", "margin", "gap")
"""Attributes of both <geom> and <pair>."""

AT_REST = {"stiffness": "N/m", "depth_at_rest": "m"}
"""Contacts at rest, in units: no attributes, but settings that decide solref of pairs."""

CONDITIONS = (
    *("friction", "mass", "gravity", "wind", "density", "viscosity", "drop_height"),
    *("joint_speed", "perturbation", "keyframe", "variant"),
)
"""Axes that set a property of matter, or the start or surroundings: no choice of numerics."""


def attribute_of(axis: str) -> str:
    """Return the attribute that an axis sets: `solref` for `solref.timeconst`, or its own name."""
    return "solref" if axis == "restitution" else axis.partition(".")[0]


def is_condition(axis: str) -> bool:
    """Return whether an axis is a physical condition: reports recommend no value of it."""
    return attribute_of(axis) in CONDITIONS


def is_setting(axis: str) -> bool:
    """Return whether an axis sets an option of the model, or an attribute of its contacts."""
    return attribute_of(axis) in {*OPTIONS, *CONTACT, *AT_REST}
