"""What a store holds: the record of each run, its accuracy and times, and the manifest."""

from typing import Annotated, Any, Literal

from pydantic import Field

from contactlab.schema.coverage import Coverage
from contactlab.schema.drive import Drive
from contactlab.schema.strict_model import Hash, InnerName, Model, Sha256, about

# Errors that a sweep may give tolerances for, as for metrics, if it asks for accuracy.
ERRORS = ("error_final", "error_mean", "error_peak")

ErrorKind = Literal["trajectory", "local", "invariants"]
SolrefRule = Literal["absolute", "tied"]


class Accuracy(Model):
    """Errors of a run against its reference; columns of the table have the same names.

    Errors are in m, angles weighted by the length of their degree of freedom; where `error_kind`
    is `invariants` they are ratios. They are null where the run or its reference failed.
    """

    error_final: float | None = about("At the last common time.")
    error_mean: float | None = about("Mean over common times.")
    error_peak: float | None = about("Largest over common times.")
    error_estimate: float | None = about(
        "Largest distance of the two finest references, a bound on the uncertainty of each error."
    )
    error_final_estimate: float | None = about(
        "Their distance at the end: a smaller `error_final` cannot be resolved."
    )
    error_mean_estimate: float | None = about(
        "Their mean distance: a smaller `error_mean` cannot be resolved."
    )
    error_velocity: float | None = about(
        "Mean difference of velocities over common times [m/s].", default=None
    )
    error_energy: float | None = about(
        "Mean difference of energy, or of momenta if conserved, as a ratio.", default=None
    )
    error_kind: ErrorKind
    chaotic: bool | None = about(
        "Whether a start 1e-8 away grows to the size of the errors; null if unknown."
    )
    divergence: float | None = about(
        "Largest distance of a start 1e-8 away from the reference [m].", default=None
    )
    reference_integrator: str | None
    reference_timestep: float | None = about("Of the finest reference [s].")
    impacts: int | None = about("How often contacts began or ended in the run.")
    solref_rule: SolrefRule | None = about(
        "Whether the time constant of solref is a multiple of the timestep, where "
        "that varies; null where it does not."
    )
    solref_clamped: bool = about(
        "Whether refsafe raised a time constant of solref to two timesteps."
    )


class Timing(Model):
    """The cost of a run when nothing is recorded; columns of the table have the same names.

    Times are null where the run failed.
    """

    time_min: float | None = about("CPU s per simulated s, least of the rounds.")
    time_median: float | None = about("CPU s per simulated s, median of the rounds.")
    step_p50: float | None = about("CPU time of a single step, median [s].")
    step_p99: float | None = about("CPU time of a single step, 99th percentile [s].")
    compile_time: float | None = about("CPU time to compile the model [s].")
    work_steps: float | None = about("Steps per simulated second.")
    work_iterations: float | None = about("Solver iterations per simulated second.")
    work_contacts: float | None = about("Contacts, summed over steps, per simulated second.")
    work_rows: float | None = about("Constraint rows, summed over steps, per simulated second.")
    timing_settings: str = about("Hash of how times were measured.")


RECORD_VERSION = 2

Scalar = bool | int | float | str
Setting = Scalar | tuple[float, ...] | None
Status = Literal["ok", "stopped", "error", "crashed", "timeout"]


class LabelEntry(Model):
    """One label that applies to the run."""

    label: str
    reason: str
    step: int | None = about("The first step at which it applied.")


class PairRecord(Model):
    """The effective contact parameters of one monitored pair."""

    condim: int
    friction: tuple[float, ...] = about(
        "Slide, slide [1]; torsion, roll, roll [m].", min_length=5, max_length=5
    )
    solref: tuple[float, ...] = Field(min_length=2, max_length=2)
    solimp: tuple[float, ...] = Field(min_length=5, max_length=5)
    margin: float = about("m")
    gap: float = about("m")


class Engine(Model):
    """The engine that computed the trajectory."""

    name: str
    version: str


class InitialState(Model):
    """The start state, exactly."""

    qpos: tuple[float, ...]
    qvel: tuple[float, ...]
    ctrl: tuple[float, ...] = about(
        "Control at the start; it stays, unless the scene drives it.", default=()
    )
    applied: tuple[float, ...] = about(
        "Force and torque on each body at the start [N, N m]; empty if none.", default=()
    )


class Cost(Model):
    """The cost of the run."""

    cpu_s: float = about("Thread CPU time of the stepping [s].")
    cpu_per_sim_s: float = about("CPU seconds per simulated second.")
    latency_budget_s: float | None = about("Wall time a step may take [s].")
    latency_used: float | None = about(
        "Mean CPU time of a step over the budget; above 1 the budget is exceeded."
    )

    @classmethod
    def of(cls, cpu: float, steps: int, timestep: float, budget: float | None) -> "Cost":
        """Return the cost of steps that took a CPU time, with a budget of each [s]."""
        simulated = steps * timestep
        return cls(
            cpu_s=cpu,
            cpu_per_sim_s=cpu / simulated if simulated else 0.0,
            latency_budget_s=budget,
            latency_used=cpu / steps / budget if budget and steps else None,
        )


class TraceFile(Model):
    """The run's MCAP file."""

    file: str = about(
        "Path relative to the store.", pattern=r"^traces/[0-9a-f]{2}/[0-9a-f]+\.mcap$"
    )
    sha256: Sha256
    bytes: int
    messages: dict[str, int] = about("Messages by topic; of a compact trace, those it stands for.")


class Host(Model):
    """The machine, as far as it can affect bits and times."""

    cpu_model: str
    cpu_flags: str = about("Hash of the CPU's feature flags.")
    cores: int
    os: str


class Provenance(Model):
    """The versions and the machine that wrote the record."""

    contactlab: str
    git_revision: str | None
    python: str
    numpy: str
    host: Host


class PluginInfo(Model):
    """A plug-in that was loaded."""

    name: str
    version: str = about("Empty if it states none.")
    sha256: str = about("Of the file, or of all files of the installed packages.")

    def __str__(self) -> str:
        """Return name, version and the start of the hash."""
        return f"{self.name} {self.version or '(no version)'}, sha256 {self.sha256[:12]}"


PluginInfos = Annotated[
    tuple[PluginInfo, ...],
    Field(
        exclude_if=lambda plugins: not plugins,
        description="Plug-ins that were loaded; left out without any.",
    ),
]


def _unsaid(description: str) -> Any:  # noqa: ANN401 - as `about`
    """Return a field of recorded loops, which others leave out."""
    return about(description, default=None, exclude_if=lambda value: value is None)


class Loop(Model):
    """What was noticed of an episode of a recorded loop."""

    unchecked: str = about("What was not checked, and why.")
    changed: tuple[str, ...] = about(
        "Fields of the model that differed from the store's when the episode began.", default=()
    )
    changed_under_way: tuple[str, ...] = about("Fields that changed during it.", default=())
    state_set: tuple[int, ...] = about("Steps before which code set the state.", default=())


class EvidenceRecord(Model):
    """Everything known about one run, except its trace. Units are SI; `units` names them."""

    schema_version: Literal[2] = RECORD_VERSION
    run_id: Hash
    index: int = about("The run's place in the plan.")
    sweep: str
    scene: str
    scene_hash: Hash
    engine: Engine
    axes: dict[str, Setting] = about("The swept values, as the sweep names them.")
    settings: dict[str, Setting] = about("Every resolved setting, defaults included.")
    effects: dict[str, bool] = about("Every effect, on or off.")
    effect_reasons: dict[str, str] = about("Why each effect is on or off.", default_factory=dict)
    effects_missed: dict[str, str] = about(
        "Effects that are off although the motion called for them, and why.", default_factory=dict
    )
    pairs: dict[str, PairRecord]
    edited_geoms: tuple[str, ...] = about("Geoms whose contact parameters were set.")
    seed: int
    initial: InitialState
    duration: float
    drive: Drive = about("What drove the run.", default="none")
    status: Status
    status_reason: str | None
    steps: int
    steps_asked: int
    warnings: dict[str, int] = about("Engine warnings by name.")
    metrics: dict[str, float | None]
    metric_versions: dict[str, int]
    units: dict[str, str]
    label: str
    labels: tuple[LabelEntry, ...] = about("Every label that applies, worst first.")
    expected: tuple[str, ...] | None
    expectation_met: bool | None
    expectation_reason: str | None
    tolerances_met: bool | None
    coverage: Coverage | None = about(
        "What the run exercised; null where it is not known.", default=None
    )
    trajectory_hash: Hash | None = about(
        "SHA-256 of time, qpos, qvel and act of every state row, as float64 bytes."
    )
    knife_edge: bool | None = about(
        "Whether a start 1e-6 away gives another label; null if unasked.", default=None
    )
    provenance: Provenance
    plugins: PluginInfos = ()
    cost: Cost | None = None
    accuracy: Accuracy | None = about("Null if the sweep requests none.", default=None)
    timing: Timing | None = about("Null if the sweep requests none.", default=None)
    trace: TraceFile | None = None
    controls: str | None = about(
        "SHA-256 of what its policy did, in controls/SHA256.arrow; null without.", default=None
    )
    started: str | None = about("UTC, ISO 8601.", default=None)
    finished: str | None = about("UTC, ISO 8601.", default=None)
    success: bool | None = _unsaid("Whether a recorded loop calls its episode a success.")
    total_reward: float | None = _unsaid("The sum of the rewards of its episode.")
    loop: Loop | None = _unsaid("What was noticed of its episode.")


STORE_VERSION = 2


class SweepIdentity(Model):
    """The definition of a store's runs; a resumed sweep must match it (`sweep.json`)."""

    store_version: Literal[2] = STORE_VERSION
    name: str
    source: str = about("The sweep file's text.")
    overrides: tuple[str, ...] = about("--set, --only and --limit, as given.")
    resolved: dict[str, Any] = about("The sweep with defaults filled in.")
    scene: str
    scene_hash: Hash
    scene_model: InnerName = about("The model file, relative to scenes/<hash>.")
    engine: Engine
    metric_versions: dict[str, int]
    definitions: Sha256 | None = Field(
        default=None,
        description="Hash of the code that prepares runs, rolls them out, measures and labels "
        "them; null in stores of older versions.",
    )
    runs_asked: int
    lacking: dict[str, str] = about(
        "Why this version of the engine leaves a value null, by the value's name.",
        default_factory=dict,
    )
    baseline: Hash | None = about(
        "Id of the first run of the scene as written, where the sweep asks for them.", default=None
    )
    plan_hash: Hash = about("Hash of every run id in plan order.")
    plugins: PluginInfos = ()


class StoreManifest(Model):
    """What a finished store holds (`manifest.json`)."""

    store_version: Literal[2] = STORE_VERSION
    sweep: SweepIdentity
    provenance: Provenance
    runs: int
    labels: dict[str, int]
    statuses: dict[str, int]
    traces: int
    traces_left_out: bool = about(
        "Whether the traces that the records name were left out, as in a baseline.", default=False
    )
    expectations: dict[str, int] = about("Runs by outcome: met, unmet, none.")
    unmet_means: tuple[str, ...] = about(
        "Which means over runs are not as the sweep expects.", default=()
    )
    files: dict[InnerName, Sha256] = about("SHA-256 of every file but traces and this one.")
    records: Sha256 | None = about(
        "Digest of every record in plan order, whatever the table's encoding; null in "
        "stores of older versions.",
        default=None,
    )
    started: str
    finished: str
