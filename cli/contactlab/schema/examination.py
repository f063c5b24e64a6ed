"""The report of `contactlab examine`: a verdict on a model's simulation under its task."""

from typing import Literal

from contactlab.schema.check_report import CheckResult
from contactlab.schema.control_loop import ControlLoopReport
from contactlab.schema.error_budget import BudgetReport
from contactlab.schema.evidence import Setting
from contactlab.schema.finding import Finding
from contactlab.schema.report_model import ReportModel
from contactlab.schema.servo import PositionServo, Servo
from contactlab.schema.strict_model import FiniteOrNull, Model, about
from contactlab.schema.task import Task
from contactlab.schema.task_verdict import TaskVerdict
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.verdict import PASSING_VERDICTS, VerdictWord
from contactlab.schema.verification import VerifiedChange

MOST_FIXES = 3
"""Fixes of a model that are reported with their lines."""

SectionName = Literal["labels", "budget", "facts", "checks", "contacts", "servos", "loop", "fixes"]
"""A part of an examination."""


class Fact(Model):
    """An observation of the model, the run or the file; it is not judged."""

    kind: Literal[
        "depth",
        "overlap",
        "creep",
        "fall",
        "limit",
        "equality",
        "force",
        "margin",
        "masks",
        "inertia",
        "grip",
        "file",
        "limp",
        "advisory",
        "servo",
        "loop",
    ]
    place: str = about("The contact, the joint, the body, or the line of a file.")
    value: float
    unit: str
    sentence: str


Stage = Literal["file", "start", "engine", "collision", "numerics", "modeling choice", "design"]
"""Kinds of causes, in the order of their repairs: later ones may follow from earlier ones."""


class Cause(Model):
    """A cause of a verdict. Each is judged with the causes before it repaired."""

    stage: Stage
    sentence: str
    fails: bool = about(
        "Whether the model fails because of it, whatever its labels and numerics say.",
        default=True,
    )
    repair: str = about("The fix that repairs it; empty without such a fix.", default="")
    verdict: VerdictWord | None = about(
        "The verdict of the model with this cause and those before it repaired; null if it was not "
        "repaired.",
        default=None,
    )
    remainder: str = about("The headline of that model; empty if not repaired.", default="")


class Fix(Model):
    """A change that removes a problem, on the task's seeds and on new ones."""

    name: str
    changes_model: bool = about(
        "Whether it makes another model, instead of computing this one differently."
    )
    apply: str = about("Its name for `--apply`, if it makes another model; otherwise empty.")
    removes: Literal["verdict", "labels", "overlap", "cause"] = about(
        "The problem that it removes: the cause of the verdict; failure labels of a run with fine "
        "numerics; overlaps at the start and bodies that press without a motor; or a first cause, "
        "after which the verdict is better.",
        default="verdict",
    )
    settings: dict[str, Setting] = about("Options, and fields of named parts, that it sets.")
    excluded_pairs: tuple[tuple[str, str], ...] = about(
        "Pairs of bodies whose contacts it excludes.", default=()
    )
    added_free_joints: tuple[str, ...] = about("Bodies that get a free joint.", default=())
    replaced_meshes: tuple[tuple[str, str], ...] = about(
        "Geoms of meshes that get the primitive which MuJoCo fits to the mesh.", default=()
    )
    changed_keyframes: tuple[tuple[str, tuple[float, ...]], ...] = about(
        "Keyframes, and the configuration that each then has.", default=()
    )
    moved_bodies: tuple[tuple[str, tuple[float, ...]], ...] = about(
        "Bodies that begin elsewhere, and the `pos` that each then has.", default=()
    )
    masked_geoms: tuple[str, ...] = about("Geoms that collide no longer.", default=())
    opened_geoms: tuple[tuple[str, str, int], ...] = about(
        "Geoms that collide with more, their mask, and its new bits.", default=()
    )
    position_servos: tuple[PositionServo, ...] = about(
        "Motors that become position servos.", default=()
    )
    changed_controls: tuple[tuple[str, tuple[float, ...]], ...] = about(
        "Keyframes, and the controls that each then has.", default=()
    )
    error: FiniteOrNull = about("Remaining error of the reason; null if infinite.")
    distance_to_reference: FiniteOrNull = about(
        "From the model's motion at its finest step, or, against a modeling choice, from that "
        "with the choice changed, as a share; null if infinite."
    )
    distance_before: FiniteOrNull = about("The same of the model as written; null if infinite.")
    time_ratio: TimeRatio | None = about("Time with the fix over time without; null if unknown.")
    lines: tuple[str, ...] = about("The lines of the model's files, each after FILE:LINE.")
    controller: str = about("The change of a controller outside of the model.", default="")
    no_patch_reason: str = about("Why there are no lines.", default="")
    verification: VerifiedChange | None = about(
        "Measures of the model with it against those of the original, if it is the first fix.",
        default=None,
    )

    @property
    def is_structural(self) -> bool:
        """Whether it changes joints, shapes, the start, or which pairs touch."""
        return bool(
            self.excluded_pairs
            or self.added_free_joints
            or self.replaced_meshes
            or self.changed_keyframes
            or self.moved_bodies
            or self.masked_geoms
            or self.opened_geoms
        )

    @property
    def moves_start(self) -> bool:
        """Whether runs begin in another configuration."""
        return bool(self.changed_keyframes or self.moved_bodies)


class RejectedFix(Model):
    """A change that removes a problem, and makes another measure worse."""

    name: str
    reason: str = about("The measure that it makes worse, before and after.")


class RunLabel(Model):
    """A failure label of runs of the task."""

    label: str
    phase: str = about("The phase in which it begins.")
    runs: int = about("Number of runs that have it.")
    reason: str = about("Why it applies to the first of these runs.")
    seed: int = about("Seed of that run.")
    time: FiniteOrNull = about("When it begins [s]; null if of the whole run.")
    bodies: tuple[str, ...] = about("Bodies that it concerns; empty if the whole run.", default=())

    @property
    def where(self) -> str:
        """The first bodies after " of ", if its reason names none; otherwise empty."""
        if not self.bodies or any(body in self.reason for body in self.bodies):
            return ""
        most_names = 4  # a hand has thirty
        more = len(self.bodies) - most_names
        rest = f" and {more} more" if more > 0 else ""
        return f" of {', '.join(self.bodies[:most_names])}{rest}"


class RestingContact(Model):
    """A monitored pair in units of the world, and its load at rest."""

    name: str
    solref: tuple[float, ...] = about("as the engine uses it")
    phase: str = about("the first of the task, at whose end it is measured")
    contacts: float = about("their mean number then; 0 if it does not rest", unit="1")
    load: float = about("on one of them", unit="N")
    depth: float = about("their mean depth, measured", unit="m")
    expected_depth: FiniteOrNull = about("by the law of rest; null without a load", unit="m")
    stiffness: float = about("in an impact", unit="N/m")
    damping: float = about("in an impact", unit="N s/m")
    damping_ratio: float = about("of an impact", unit="1")
    restitution: float = about("of an impact without gravity, by the law", unit="1")
    bounced: FiniteOrNull = about("restitution in the run; null if nothing bounced", unit="1")
    longest_step: float = about("timestep that resolves it", unit="s")
    timestep: float = about("of the run", unit="s")


class Examination(ReportModel):
    """Result of an examination of a model under its task.

    It has an error budget, the labels of runs, checks, facts and fixes.
    """

    examination_version: Literal[2] = 2
    model: str = about("The scene or model, by its name on the command line.")
    mujoco: str = about("Version of MuJoCo.")
    task: Task
    sections: tuple[SectionName, ...] = about("The requested sections.")
    verdict: VerdictWord | None = about(
        "The verdict of the whole examination; null if only contacts, servos or the loop were "
        "requested.",
        default=None,
    )
    headline: str = about(
        "The verdict in at most 15 words; empty if only contacts were requested.", default=""
    )
    why: tuple[str, ...] = about(
        "Place, time, number and limit of each cause, the main cause first.", default=()
    )
    fix: str = about("Summary of the first fix, or why no fix was found.", default="")
    causes: tuple[Cause, ...] = about(
        "Faults of the file and the start that come before all others, in the order of repairs.",
        default=(),
    )
    task_verdict: TaskVerdict | None = about(
        "The numerics of the task and the labels of its runs; null if not requested.",
        default=None,
    )
    budget: BudgetReport | None = about(
        "Times in it count from the beginning of the phase. Without the section of this name, it "
        "has no rows; null if only contacts were requested.",
        default=None,
    )
    labels: tuple[RunLabel, ...] = about("Failure labels of the runs.", default=())
    facts: tuple[Fact, ...] = ()
    checks: tuple[CheckResult, ...] = ()
    findings: tuple[Finding, ...] = about("Results of the checks, failures first.", default=())
    contacts: tuple[RestingContact, ...] = ()
    servos: tuple[Servo, ...] = ()
    loop: ControlLoopReport | None = about("Of a policy; null without one.", default=None)
    requested: tuple[str, ...] = about(
        "Requested values of contacts, such as `depth_at_rest`, which settings were found for.",
        default=(),
    )
    missed: tuple[str, ...] = about(
        "Requested values that a run with these settings does not reach.", default=()
    )
    fixes: tuple[Fix, ...] = about(
        "At most three, the cheapest first, those that `--apply` names, and those that separate "
        "overlapping bodies.",
        default=(),
    )
    rejected_fixes: tuple[RejectedFix, ...] = about(
        "Changes that made a measure of their verification worse.", default=()
    )
    not_tried: tuple[str, ...] = about(
        "Rows of the budget that are not judged, and fixes, that were skipped so that the "
        "examination ended within its CPU limit.",
        default=(),
    )
    notes: tuple[str, ...] = ()
    written: str | None = about("The fixed model's file, if one was written.", default=None)
    not_written: str = about(
        "Why a requested fix was not written; empty if it was, or none was requested.", default=""
    )
    evidence: str | None = about("Folder of its stores; null if they were not kept.", default=None)
    page: str | None = about("Its page; null if none was drawn.", default=None)

    @property
    def problem(self) -> str:
        """The verdict of a model that does not pass; its output says why."""
        if self.missed:
            return "\n".join(["a run does not reach it:", *self.missed])
        return "" if self.passed else f"{self.model}: {self.verdict}"

    @property
    def passed(self) -> bool:
        """Whether the verdict passes, which takes the selected checks and waivers into account."""
        return self.verdict is None or self.verdict in PASSING_VERDICTS


class Examinations(ReportModel):
    """Results of several models."""

    examinations: tuple[Examination, ...]

    @property
    def failing_models(self) -> tuple[str, ...]:
        """The models that do not pass."""
        return tuple(one.model for one in self.examinations if one.problem)

    @property
    def headline(self) -> str:
        """The number of models that pass, and the names of the others."""
        count, failing = len(self.examinations), len(self.failing_models)
        passing = f"{count - failing} of {count} models pass"
        return (
            f"{passing}; not {', '.join(self.failing_models)}" if self.failing_models else passing
        )

    @property
    def problem(self) -> str:
        """The headline, if a model does not pass."""
        return self.headline if self.failing_models else ""
