"""The report of `contactlab parity`: verdicts on runs and on a sweep."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.finding import Finding
from contactlab.schema.strict_model import FiniteOrNull, Model, about

Verdict = Literal["same", "within noise floor", "ambiguous", "different", "refused", "failed"]
Stage = Literal[
    "buffers",
    "kinematics",
    "contacts",
    "forces",
    "smooth acceleration",
    "constraint forces",
    "acceleration",
    "one step",
    "whole run",
]


class Divergence(Model):
    """The first difference of an engine from MuJoCo."""

    stage: Stage = about("The first stage, in the order in which a step computes them.")
    quantity: str = about(
        "Quantity that differs: a field of MuJoCo's data, or of the contacts of a pair."
    )
    step: int = about("The step after the state in which it differs.")
    mujoco: FiniteOrNull = None
    engine: FiniteOrNull = None

    def __str__(self) -> str:
        """Return `contacts: count of left - box at step 40, 8 -> 4`."""
        values = (self.mujoco, self.engine)
        value_texts = [f"{value:.6g}" for value in values if value is not None]
        text = f"{self.stage}: {self.quantity} at step {self.step}"
        return f"{text}, {' -> '.join(value_texts)}" if value_texts else text


class Measured(Model):
    """One quantity of a run by both engines, and by MuJoCo with rounded states."""

    mujoco: FiniteOrNull
    engine: FiniteOrNull
    rounded_mujoco: FiniteOrNull = about("By MuJoCo with states rounded to single precision.")
    difference: FiniteOrNull = about("Share of MuJoCo's value; for success, 1 if they disagree.")
    above_tolerance: bool = about("Whether it is more than the policy and rounding allow.")


class RunParity(Model):
    """One run by both engines."""

    run_id: str
    axes: dict[str, Setting]
    seed: int
    verdict: Verdict
    reason: str = about("Why it is refused, or what failed.", default="")
    first_divergence: Divergence | None = about("Null if nothing differs.", default=None)
    position: FiniteOrNull = about("Largest difference of a coordinate [m or rad].", default=None)
    noise_floor: FiniteOrNull = about(
        "The same for MuJoCo against itself, rounded to single precision.", default=None
    )
    repeat_difference: FiniteOrNull = about("The same for the engine against itself.", default=None)
    step: FiniteOrNull = about(
        "Largest difference of a velocity after one step from MuJoCo's states [m/s or rad/s].",
        default=None,
    )
    step_noise_floor: FiniteOrNull = about("The same for MuJoCo from rounded states.", default=None)
    ambiguous_states: int = about("Number of states whose contacts rounding may change.", default=0)
    labels: tuple[str, str] | None = about("Worst label by MuJoCo, by the engine.", default=None)
    measured: dict[str, Measured] = about("Judged quantities by name.", default={})


class ClosedForm(Model):
    """Differences of both engines from the closed form of the scene."""

    mujoco: float = about("Largest oracle_error of its runs.")
    engine: float
    inaccurate: Literal["neither", "mujoco", "engine", "both"]


class ParityReport(Model):
    """Whether an engine agrees with MuJoCo in the runs of a sweep."""

    schema_version: Literal[3] = 3
    sweep: str
    scene: str
    engine: str
    version: str
    mujoco: str
    device: str
    changes: tuple[str, ...] = about("Settings of the engine only.", default=())
    exit_code: int
    headline: str
    verdicts: dict[Verdict, int]
    findings: tuple[Finding, ...]
    closed_form: ClosedForm | None
    runs: tuple[RunParity, ...]
