"""The servos of a model: their stiffness, their sag, and the gains that the step holds."""

from contactlab.schema.strict_model import FiniteOrNull, Model, about


class Servo(Model):
    """The actuators that move a joint or a mechanism by feedback, at the start of the task.

    Other joints are locked, except those that an equality moves along.
    """

    name: str = about("The joint that it moves most.")
    actuators: tuple[str, ...]
    body: str = about("The body that it moves.")
    unit: str = about("Of its motion: rad or m.")
    stiffness: float = about("Of its feedback along the joint [N/m or Nm/rad].")
    tip_stiffness: FiniteOrNull = about(
        "Of a hinge at the farthest point of its body [N/m]; null for a slide, or without a lever."
    )
    damping: float = about("Of its feedback and of the joint [N s/m or Nm s/rad].")
    inertia: float = about("That it moves [kg or kg m^2].")
    frequency: FiniteOrNull = about("Natural frequency [Hz]; null without stiffness.")
    damping_ratio: FiniteOrNull = about("Of that motion; null without stiffness.")
    travel: FiniteOrNull = about("Of the joint's range, or of the control's; null without one.")
    gravity_load: float = about("That gravity and springs put on it [N or Nm].")
    gravity_sag: FiniteOrNull = about("Load over stiffness [m or rad]; null without stiffness.")
    task_load: FiniteOrNull = about("Its mean force at the end of the first phase [N or Nm].")
    task_sag: FiniteOrNull = about("That load over stiffness [m or rad]; null without stiffness.")
    held_body: str = about("A moving body that it then presses on; otherwise empty.")
    held_size: FiniteOrNull = about("Smallest extent of that body [m].")
    timestep: float = about("Of the run [s].")
    integrator: str
    holds: bool = about("Whether the step holds it: none of its motions grows.")
    largest_gain: FiniteOrNull = about(
        "Largest factor on all its gains that the step holds; null if beyond 100, or if another "
        "servo is not held."
    )
    largest_stiffness: FiniteOrNull = about(
        "Largest stiffness that the step holds with the damping as written; null likewise."
    )
    largest_damping: FiniteOrNull = about(
        "Largest damping of the feedback that the step holds; null likewise."
    )
    armature: float = about("Of its joint [kg or kg m^2].")
    least_armature: FiniteOrNull = about(
        "Least armature of its joint that the step holds; null if none does."
    )


class PositionServo(Model):
    """A motor as a position servo within the same forces."""

    actuator: str
    kp: float = about("Force per length of the actuator.")
    kv: float = about("Force per speed of the length.")
    forces: tuple[float, float] | None = about("Least and largest force; null without a limit.")
    targets: tuple[float, float] = about(
        "Range of its joint, as lengths; zeros without a limit. Targets are not clamped to it."
    )
