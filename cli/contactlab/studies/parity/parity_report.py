"""The report of `contactlab parity`, and what it says of a run and of a sweep."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.finding import Finding
from contactlab.schema.strict_model import Model, about

Verdict = Literal["same", "within floor", "ambiguous", "different", "refused", "failed"]
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
    """Where an engine first leaves MuJoCo."""

    stage: Stage = about("The first stage, in the order in which a step computes them.")
    quantity: str = about("What differs: a field of MuJoCo's data, or of a pair's contacts.")
    step: int = about("The step before which the state is that it differs at.")
    mujoco: float | None = None
    engine: float | None = None

    def __str__(self) -> str:
        """Return `contacts: count of left - box at step 40, 8 -> 4`."""
        values = (self.mujoco, self.engine)
        shown = [f"{value:.6g}" for value in values if value is not None]
        told = f"{self.stage}: {self.quantity} at step {self.step}"
        return f"{told}, {' -> '.join(shown)}" if shown else told


class Measured(Model):
    """One quantity of a run by both, and what rounding makes of MuJoCo's."""

    mujoco: float | None
    engine: float | None
    rounded: float | None = about("By MuJoCo, of which each state is rounded to single precision.")
    difference: float | None = about("As a share of MuJoCo's; of success, 1 if they disagree.")
    beyond: bool = about("Whether that is more than the policy and rounding allow.")


class RunParity(Model):
    """One run by both engines."""

    run_id: str
    axes: dict[str, Setting]
    seed: int
    verdict: Verdict
    reason: str = about("Why it is refused, or what failed.", default="")
    first: Divergence | None = about("Where it first differs; null unless it does.", default=None)
    position: float | None = about("Greatest difference of a coordinate [m or rad].", default=None)
    floor: float | None = about(
        "The same of MuJoCo against itself, rounded to single precision.", default=None
    )
    repeat: float | None = about("The same of the engine against itself.", default=None)
    step: float | None = about(
        "Greatest difference of a velocity after one step from MuJoCo's states [m/s or rad/s].",
        default=None,
    )
    step_floor: float | None = about("The same of MuJoCo from rounded states.", default=None)
    ambiguous_states: int = about("States whose contacts rounding may change.", default=0)
    labels: tuple[str, str] | None = about("Worst label by MuJoCo, by the engine.", default=None)
    measured: dict[str, Measured] = about("What is judged of it, by name.", default={})


class ClosedForm(Model):
    """How far both are from what the scene's closed form expects, and who is off."""

    mujoco: float = about("Greatest oracle_error of its runs.")
    engine: float
    off: Literal["neither", "mujoco", "engine", "both"]


class ParityReport(Model):
    """Whether an engine does what MuJoCo does in the runs of a sweep."""

    schema_version: Literal[2] = 2
    sweep: str
    scene: str
    engine: str
    version: str
    mujoco: str
    device: str
    changes: tuple[str, ...] = about("What is set for the engine alone.", default=())
    exit_code: int
    headline: str
    verdicts: dict[Verdict, int]
    findings: tuple[Finding, ...]
    closed_form: ClosedForm | None
    runs: tuple[RunParity, ...]
