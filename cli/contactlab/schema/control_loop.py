"""The loop of a controller and a model: its fastest growth, and the margins that it has."""

from typing import Literal

from contactlab.schema.strict_model import FiniteOrNull, Model, about


class LoopMargin(Model):
    """The border of one parameter of a loop; other parameters are unchanged."""

    name: Literal["rate", "delay", "gain", "armature"] = about(
        "rate of the controller; delay from observation to action; factor on its gains; least "
        "armature of all driven joints"
    )
    unit: str
    holds_above: bool = about("Whether larger values hold, instead of smaller ones.")
    current: float
    linear: FiniteOrNull = about("Border of the linear loop; null without one.")
    border: FiniteOrNull = about("Border of the simulated loop; null without one.")
    doubled: FiniteOrNull = about(
        "Border of the rate or the armature at twice the gains, if the loop does not hold.",
        default=None,
    )


class ControlLoopReport(Model):
    """Whether the loop of a controller holds, and its margins."""

    rate: float = about("Of the controller [Hz].")
    latency: float = about("From observation to action [s].")
    timestep: float = about("Of the loop: the largest that divides a period [s].")
    growth: FiniteOrNull = about(
        "Of the fastest mode of the linear loop [1/s]; null if MuJoCo gives up."
    )
    eigenvalue: FiniteOrNull = about("Its magnitude over a control period.")
    joint: str = about("The joint that it moves most.")
    simulated_growth: FiniteOrNull = about("Of a small offset in a run [1/s]; null likewise.")
    allowed_growth: float = about(
        "The largest of a loop that holds [1/s]: above that of the model under a controller that "
        "is much faster."
    )
    holds: bool = about("Whether the simulated loop holds.")
    inside: bool | None = about(
        "Whether the same PD holds as position servos of the model, with its step and an implicit "
        "integrator; null unless the policy is a PD that states its gains.",
        default=None,
    )
    margins: tuple[LoopMargin, ...] = ()
