"""The EvidenceRecord: all that is known of one run, but for its trace."""

from typing import Literal

from pydantic import Field

from contactlab.schema.accuracy import Accuracy, Timing
from contactlab.schema.model import Model

RECORD_VERSION = 2

Scalar = bool | int | float | str
Setting = Scalar | tuple[float, ...] | None
Status = Literal["ok", "stopped", "error", "crashed", "timeout"]


class LabelEntry(Model):
    """One label that applies to the run."""

    label: str
    reason: str
    step: int | None = Field(description="The step at which it was first met.")


class PairRecord(Model):
    """The effective contact parameters of one graded pair."""

    condim: int
    friction: tuple[float, ...] = Field(
        min_length=5, max_length=5, description="Slide, slide [1]; torsion, roll, roll [m]."
    )
    solref: tuple[float, ...] = Field(min_length=2, max_length=2)
    solimp: tuple[float, ...] = Field(min_length=5, max_length=5)
    margin: float = Field(description="m")
    gap: float = Field(description="m")


class Engine(Model):
    """What computed the trajectory."""

    name: str
    version: str


class InitialState(Model):
    """The start state, exactly."""

    qpos: tuple[float, ...]
    qvel: tuple[float, ...]
    ctrl: tuple[float, ...] = Field(
        default=(), description="Control at the start; it stays, unless the scene drives it."
    )
    applied: tuple[float, ...] = Field(
        default=(),
        description="Force and torque on each body at the start [N, N m]; empty if none.",
    )


class Cost(Model):
    """What the run took."""

    cpu_s: float = Field(description="Thread CPU time of the stepping [s].")
    cpu_per_sim_s: float = Field(description="CPU seconds per simulated second.")
    latency_budget_s: float | None = Field(description="Wall time a step may take [s].")
    latency_used: float | None = Field(
        description="Mean CPU time of a step over the budget; above 1 the budget is exceeded."
    )


class TraceFile(Model):
    """The run's MCAP file."""

    file: str = Field(description="Path relative to the store.")
    sha256: str
    bytes: int
    messages: dict[str, int] = Field(description="Messages by topic.")


class Host(Model):
    """The machine, as far as it can matter to bits and times."""

    cpu_model: str
    cpu_flags: str = Field(description="Hash of the CPU's feature flags.")
    cores: int
    os: str


class Provenance(Model):
    """What wrote the record."""

    contactlab: str
    git_revision: str | None
    python: str
    numpy: str
    host: Host


class EvidenceRecord(Model):
    """All that is known of one run, but for its trace. Units are SI; `units` names them."""

    schema_version: Literal[2] = RECORD_VERSION
    run_id: str
    index: int = Field(description="The run's place in the plan.")
    sweep: str
    scene: str
    scene_hash: str
    engine: Engine
    axes: dict[str, Setting] = Field(description="The swept values, as the sweep names them.")
    settings: dict[str, Setting] = Field(description="Every resolved setting, defaults included.")
    effects: dict[str, bool] = Field(description="Every effect, on or off.")
    effect_reasons: dict[str, str] = Field(
        default_factory=dict, description="Why each effect is on or off."
    )
    effects_missed: dict[str, str] = Field(
        default_factory=dict,
        description="Effects that are off although what the bodies did called for them, with what "
        "was seen.",
    )
    pairs: dict[str, PairRecord]
    edited_geoms: tuple[str, ...] = Field(description="Geoms whose contact parameters were set.")
    seed: int
    initial: InitialState
    duration: float
    status: Status
    status_reason: str | None
    steps: int
    steps_asked: int
    warnings: dict[str, int] = Field(description="Engine warnings by name.")
    metrics: dict[str, float | None]
    metric_versions: dict[str, int]
    units: dict[str, str]
    label: str
    labels: tuple[LabelEntry, ...] = Field(description="Every label that applies, worst first.")
    expected: tuple[str, ...] | None
    expectation_met: bool | None
    expectation_reason: str | None
    tolerances_met: bool | None
    trajectory_hash: str | None = Field(
        description="SHA-256 of time, qpos, qvel and act of every state row, as float64 bytes."
    )
    knife_edge: bool | None = Field(
        default=None, description="Whether a start 1e-6 away gives another label; null if unasked."
    )
    provenance: Provenance
    cost: Cost | None = None
    accuracy: Accuracy | None = Field(default=None, description="Null if the sweep asks for none.")
    timing: Timing | None = Field(default=None, description="Null if the sweep asks for none.")
    trace: TraceFile | None = None
    started: str | None = Field(default=None, description="UTC, ISO 8601.")
    finished: str | None = Field(default=None, description="UTC, ISO 8601.")
