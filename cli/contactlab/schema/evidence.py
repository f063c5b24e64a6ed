"""Documents of a store: the record of each run, its accuracy and times, and the manifest.

A field of the record is described here alone: the columns of the table, the JSON schema and the
list of columns in docs/reference/columns.md follow.
"""

import re
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator

from contactlab.schema.coverage import Coverage
from contactlab.schema.drive import Drive
from contactlab.schema.strict_model import Hash, InnerName, Model, Sha256, about

# Errors that a sweep may give tolerances for, as for metrics, if it asks for accuracy.
ERRORS = ("error_final", "error_mean", "error_peak")

ErrorKind = Literal["trajectory", "local", "invariants"]
SolrefRule = Literal["absolute", "tied"]


class InTable(Enum):
    """Form of a record's field in the table, where its type does not say it."""

    SHARED = "once, in the table's metadata, since all runs of a store share it"
    BY_NAME = "each entry in a column that has the entry's own name"
    STRUCT = "a struct with a field for each entry"
    WITHOUT_DEFAULTS = "JSON without the entries that have their default"


@dataclass(frozen=True)
class InColumns:
    """A field with its own fields as columns; their names begin with a prefix."""

    prefix: str


class Accuracy(Model):
    """Errors of a run against its reference; columns of the table have the same names.

    Errors are in m, angles weighted by the length of their degree of freedom; where `error_kind`
    is `invariants` they are ratios. They are null where the run or its reference failed. An error
    smaller than its estimate cannot be resolved.
    """

    error_final: float | None = about(
        "distance from the reference at the end", unit="m", better="lower"
    )
    error_mean: float | None = about(
        "distance from the reference, mean over time", unit="m", better="lower"
    )
    error_peak: float | None = about(
        "distance from the reference, largest", unit="m", better="lower"
    )
    error_estimate: float | None = about(
        "what the reference itself may be off by", unit="m", better="lower"
    )
    error_final_estimate: float | None = about("the same for the error at the end", unit="m")
    error_mean_estimate: float | None = about("the same for the mean error", unit="m")
    error_velocity: float | None = about(
        "difference of velocities, mean over time", unit="m/s", better="lower", default=None
    )
    error_energy: float | None = about(
        "difference of energy and momenta, mean over time", unit="1", better="lower", default=None
    )
    error_kind: ErrorKind = about("trajectory, local or invariants; the last have no unit")
    chaotic: bool | None = about("whether a start 1e-8 away grows to the size of the errors")
    divergence: float | None = about(
        "how far a start 1e-8 away gets from the reference", unit="m", default=None
    )
    reference_integrator: str | None = about("the reference's integrator")
    reference_timestep: float | None = about("the finest reference's timestep", unit="s")
    impacts: int | None = about("how often contacts began or ended in the run", unit="1")
    solref_rule: SolrefRule | None = about("absolute, or tied to the timestep")
    solref_clamped: bool = about("whether refsafe raised solref to two timesteps")


class Timing(Model):
    """The cost of a run when nothing is recorded; columns of the table have the same names.

    Times are null where the run failed.
    """

    time_min: float | None = about(
        "CPU s per simulated s, least of the rounds", unit="1", better="lower"
    )
    time_median: float | None = about(
        "CPU s per simulated s, median of the rounds", unit="1", better="lower"
    )
    step_p50: float | None = about("CPU time of a single step, median", unit="s", better="lower")
    step_p99: float | None = about(
        "CPU time of a single step, 99th percentile", unit="s", better="lower"
    )
    compile_time: float | None = about("CPU time to compile the model", unit="s", better="lower")
    work_steps: float | None = about("steps per simulated second", unit="1/s", better="lower")
    work_iterations: float | None = about(
        "solver iterations per simulated second", unit="1/s", better="lower"
    )
    work_contacts: float | None = about(
        "contacts of all steps per simulated second", unit="1/s", better="lower"
    )
    work_rows: float | None = about(
        "constraint rows of all steps per simulated second", unit="1/s", better="lower"
    )
    timing_settings: str = about("hash of how times were measured")


RECORD_VERSION = 2

Scalar = bool | int | float | str
Setting = Scalar | tuple[float, ...] | None
Status = Literal["ok", "stopped", "error", "crashed", "timeout"]


class LabelEntry(Model):
    """One label that applies to the run."""

    label: str
    reason: str = about("why it applies")
    step: int | None = about("step at which it was first met", unit="1")
    bodies: tuple[str, ...] = about(
        "those that it is of; none if it is of the whole run", default=()
    )


class LabelFacts(Model):
    """Description of a label that a plug-in declared, for readers without the plug-in."""

    meaning: str = ""
    advice: str = about("what to change", default="")
    letter: str = about("one character for it on maps", default="", max_length=1)
    colour: str = about("its color in pictures", default="", pattern="^(#[0-9a-f]{6})?$")


class PairRecord(Model):
    """The contact parameters of one monitored pair, mixed from its geoms, before refsafe."""

    condim: int
    friction: tuple[float, ...] = about(
        "slide, slide [1]; torsion, roll, roll [m]", min_length=5, max_length=5
    )
    solref: tuple[float, ...] = Field(min_length=2, max_length=2)
    solimp: tuple[float, ...] = Field(min_length=5, max_length=5)
    margin: float = about("distance at which a contact is made", unit="m")
    gap: float = about("part of the margin in which it exerts no force", unit="m")


class Engine(Model):
    """The engine that computed the trajectory."""

    name: str = about("what computed the trajectory")
    version: str = about("its version")


class InitialState(Model):
    """The start state, exactly. A scene's drive changes the control; force and torque: N, N m."""

    qpos: tuple[float, ...] = about("start configuration")
    qvel: tuple[float, ...] = about("start velocity")
    ctrl: tuple[float, ...] = about("constant control", default=())
    applied: tuple[float, ...] = about("constant force and torque on each body", default=())


class Cost(Model):
    """The cost of the run."""

    cpu_s: float = about("thread CPU time of the stepping", unit="s")
    cpu_per_sim_s: float = about("CPU seconds per simulated second", unit="1", better="lower")
    latency_budget_s: float | None = about("wall time a step may take", unit="s")
    latency_used: float | None = about("mean CPU time of a step over the budget", unit="1")

    @classmethod
    def of_steps(cls, cpu: float, steps: int, timestep: float, budget: float | None) -> "Cost":
        """Return the cost of steps that took a CPU time, with a budget of each [s]."""
        simulated = steps * timestep
        return cls(
            cpu_s=cpu,
            cpu_per_sim_s=cpu / simulated if simulated else 0.0,
            latency_budget_s=budget,
            latency_used=cpu / steps / budget if budget and steps else None,
        )


class TraceFile(Model):
    """The run's MCAP file. The messages of a compact trace are those that it stands for."""

    file: str = about(
        "the run's MCAP file, relative to the store",
        pattern=r"^traces/[0-9a-f]{2}/[0-9a-f]+\.mcap$",
    )
    sha256: Sha256 = about("its SHA-256")
    bytes: int = about("its size", unit="B")
    messages: dict[str, int] = about("its messages by topic")


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
        description="plug-ins that were loaded",
    ),
]


def _optional_field(description: str) -> Any:  # noqa: ANN401 - as `about`
    """Return a field of recorded loops, which others leave out."""
    return about(description, default=None, exclude_if=lambda value: value is None)


class Loop(Model):
    """Observations of an episode of a recorded loop."""

    unchecked: str = about("The checks that were not made, and why.")
    changed: tuple[str, ...] = about(
        "Fields of the model that differed from the store's when the episode began.", default=()
    )
    changed_under_way: tuple[str, ...] = about("Fields that changed during it.", default=())
    state_set: tuple[int, ...] = about("Steps after a state that code set.", default=())


class EvidenceRecord(Model):
    """Everything known about one run, except its trace. Units are SI; `units` names them.

    The trajectory's hash is of time, qpos, qvel and act of every state row, as float64 bytes; the
    controls are in controls/SHA256.arrow. A field that does not apply is null.
    """

    schema_version: Annotated[Literal[2], InTable.SHARED] = RECORD_VERSION
    run_id: Hash = about("hash of scene content, settings, seed and duration")
    index: int = about("the run's place in the plan", unit="1")
    sweep: Annotated[str, InTable.SHARED]
    scene: str = about("scene's name")
    scene_hash: Hash = about("hash of the scene's files")
    engine: Annotated[Engine, InColumns("engine_")]
    axes: Annotated[dict[str, Setting], InTable.BY_NAME] = about(
        "The swept values, as the sweep names them."
    )
    settings: Annotated[dict[str, Setting], InTable.STRUCT] = about("every resolved setting")
    effects: Annotated[dict[str, bool], InTable.STRUCT] = about("every effect, on or off")
    effect_reasons: dict[str, str] = about("why each effect is on or off", default_factory=dict)
    effects_missed: dict[str, str] = about(
        "effects that are off although the run called for them", default_factory=dict
    )
    pairs: dict[str, PairRecord] = about(
        "contact parameters of each pair, mixed from its geoms, before refsafe"
    )
    edited_geoms: tuple[str, ...] = about("geoms whose contact parameters were set")
    seed: int = about("what perturbed the start state", unit="1")
    initial: Annotated[InitialState, InColumns("initial_")]
    duration: float = about("simulated time asked for", unit="s")
    drive: Drive = about("what drove the run", default="none")
    status: Status = about("ok, stopped, error, crashed or timeout")
    status_reason: str | None = about("what ended the run, if it did not go through")
    steps: int = about("steps made", unit="1")
    steps_asked: int = about("steps asked for", unit="1")
    warnings: dict[str, int] = about("engine warnings by name")
    metrics: Annotated[dict[str, float | None], InTable.BY_NAME]
    metric_versions: Annotated[dict[str, int], InTable.SHARED]
    units: Annotated[dict[str, str], InTable.SHARED]
    label: str = about("worst label")
    labels: tuple[LabelEntry, ...] = about("every label that applies, worst first")
    expected: tuple[str, ...] | None = about("labels of which one was expected")
    expectation_met: bool | None = about("whether what was expected came out")
    expectation_reason: str | None = about("what was missed")
    tolerances_met: bool | None = about("whether every tolerance of the sweep is met")
    coverage: Annotated[Coverage | None, InTable.WITHOUT_DEFAULTS] = about(
        "what moved, was loaded and touched", default=None
    )
    trajectory_hash: Hash | None = about("SHA-256 of every state row")
    knife_edge: bool | None = about("whether a start 1e-6 away gives another label", default=None)
    backward_error_body: str | None = about("the body whose backward_error it is", default=None)
    provenance: Provenance = about("tool, host and versions")
    plugins: PluginInfos = ()
    cost: Annotated[Cost | None, InColumns("cost_")] = None
    accuracy: Annotated[Accuracy | None, InColumns("")] = about(
        "Null if the sweep requests none.", default=None
    )
    timing: Annotated[Timing | None, InColumns("")] = about(
        "Null if the sweep requests none.", default=None
    )
    trace: Annotated[TraceFile | None, InColumns("trace_")] = None
    controls: str | None = about(
        "hash of what was applied to the run, which names its file", default=None
    )
    started: str | None = about("UTC, ISO 8601", default=None)
    finished: str | None = about("UTC, ISO 8601", default=None)
    success: bool | None = _optional_field("whether the loop calls its episode a success")
    total_reward: float | None = _optional_field("sum of the rewards of the episode")
    loop: Annotated[Loop | None, InTable.WITHOUT_DEFAULTS] = _optional_field(
        "what was noticed of the episode"
    )


STORE_VERSION = 4
Shard = Annotated[str, Field(pattern="^[1-9][0-9]*/[1-9][0-9]*$")]


class WholeGrid(Model):
    """The grid of a sweep that ran a part of it: a shard, or the runs that others called for."""

    shard: Shard | None = about(
        "Which slice of the full grid ran, such as 3/64; null where another part did.",
        default=None,
        exclude_if=lambda shard: shard is None,
    )
    runs: int = about("Runs of the full grid.")
    axes: dict[str, tuple[Any, ...]] = about(
        "Values of each refined axis in the full grid.", default={}
    )
    inside: int = about("Runs of the full grid that lie within uniform cells.", default=0)
    probes: int = about("Runs among those that were made, and are as their cells are.", default=0)


class SweepIdentity(Model):
    """The definition of a store's runs; a resumed sweep must match it (`sweep.json`)."""

    store_version: Literal[4] = STORE_VERSION
    name: str
    source: str = about("The sweep file's text.")
    overrides: tuple[str, ...] = about("--set, --where and --limit, as typed.")
    resolved: dict[str, Any] = about("The sweep with defaults filled in.")
    scene: str
    scene_hash: Hash
    scene_model: InnerName = about("The model file, relative to scenes/<hash>.")
    engine: Engine
    metric_versions: dict[str, int]
    definitions: Sha256 = about(
        "Hash of the code that prepares runs, rolls them out, measures and labels them."
    )
    runs_asked: int
    lacking: dict[str, str] = about(
        "Why this version of the engine leaves a value null, by the value's name.",
        default_factory=dict,
    )
    baseline: Hash | None = about(
        "Id of the first run of the scene as written, where the sweep asks for them.", default=None
    )
    plan_hash: Hash = about(
        "Hash of the id of each row's first run in plan order, a row being the runs that differ in "
        "their seed alone; of the full grid, whichever part of it ran."
    )
    whole: WholeGrid | None = about(
        "The grid that these runs are a part of, where not all of it ran; the counts above are "
        "then of the runs that were made.",
        default=None,
        exclude_if=lambda grid: grid is None,
    )
    plugins: PluginInfos = ()

    @field_validator("overrides")
    @classmethod
    def _rename_filters(cls, overrides: tuple[str, ...]) -> tuple[str, ...]:
        # `--only` is the name of `--where` in stores that were written before 0.3.
        return tuple(re.sub(r"^--only ", "--where ", override) for override in overrides)


class ParameterRow(Model):
    """A row of an error budget: a sampled axis at either end of its range."""

    axis: str
    low: float
    high: float
    share: float | None = about(
        "Extra forces that would make the run the motion of the model at the worse end, as a share "
        "of the real forces on the worst body; null if the engine gave up."
    )
    body: str = about("That body.")


class ParameterBudget(Model):
    """Effect of sampled axes in the windows of one run, in the middle of their ranges."""

    shared: dict[str, Setting] = about("Its other axes, and its seed.")
    middle: dict[str, Setting] = about("Its sampled axes.")
    run: float | None = about("The run itself against the reference; null where it gave up.")
    rows: tuple[ParameterRow, ...] = about(
        "Axes that change a number of the model, not its start or drive."
    )


class StoreManifest(Model):
    """Contents of a finished store (`manifest.json`)."""

    store_version: Literal[4] = STORE_VERSION
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
    parameter_budgets: tuple[ParameterBudget, ...] = about(
        "Only of a sweep with a sample for sensitivities.",
        default=(),
        exclude_if=lambda budgets: not budgets,
    )
    advisories: tuple[str, ...] = about(
        "Ids of the advisories that models of the sweep meet under their engines; of many models, "
        "some are examined.",
        default=(),
        exclude_if=lambda ids: not ids,
    )
    unrepeatable: tuple[str, ...] = about(
        "Ids of runs with a policy that differ when they are repeated; a sweep tries one run.",
        default=(),
        exclude_if=lambda ids: not ids,
    )
    files: dict[InnerName, Sha256] = about("SHA-256 of every file but traces and this one.")
    records: Sha256 = about("Digest of every record in plan order, whatever the table's encoding.")
    physics: Sha256 | None = about(
        "The same without clocks, costs, times, machines and traces: two honest repeats have the "
        "same one. Null where an earlier contactlab wrote the store.",
        default=None,
    )
    started: str
    finished: str
