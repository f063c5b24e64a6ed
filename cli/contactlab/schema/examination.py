"""The report of `contactlab examine`: a verdict on a model's simulation under its task."""

from html import escape
from typing import Literal

from contactlab.schema.check_report import CheckResult
from contactlab.schema.error_budget import BudgetPrice, BudgetReport
from contactlab.schema.evidence import Setting
from contactlab.schema.finding import Finding
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task
from contactlab.schema.task_verdict import TaskVerdict

MOST_CHANGES = 3
"""Changes of a model that are told with their lines."""

SectionName = Literal["labels", "budget", "facts", "checks", "contacts", "changes"]
"""A part of an examination; `changes` are of what the budget names."""


class Fact(Model):
    """What is deep, overlaps, is apart, creeps, grips, goes through, or is wrong in the file.

    It judges nothing.
    """

    kind: Literal[
        "depth",
        "overlap",
        "creep",
        "limit",
        "equality",
        "force",
        "margin",
        "masks",
        "inertia",
        "grip",
        "file",
    ]
    place: str = about("The contact, the joint, the body, or the line of a file.")
    value: float
    unit: str
    sentence: str


class ModelChange(Model):
    """A change that mends something, on the task's seeds and on fresh ones."""

    name: str
    physics: bool = about("Whether it makes another model, not another computation of this one.")
    accept: str = about("What `--accept` calls it, if it makes another model; else empty.")
    removes: Literal["verdict", "labels", "overlap"] = about(
        "What it removes: what the verdict names; labels of a run that is numerically sound; or, "
        "beside a verdict, overlaps at the start and forces of a thousand weights.",
        default="verdict",
    )
    settings: dict[str, Setting] = about("What it sets: options, and fields of named parts.")
    excluded: tuple[tuple[str, str], ...] = about(
        "Pairs of bodies whose contacts it excludes.", default=()
    )
    freed: tuple[str, ...] = about("Bodies that it gives a free joint.", default=())
    fitted: tuple[tuple[str, str], ...] = about(
        "Geoms of meshes that get the primitive which MuJoCo fits to the mesh.", default=()
    )
    posed: tuple[tuple[str, tuple[float, ...]], ...] = about(
        "Keyframes, and the configuration that each then has.", default=()
    )
    share: float | None = about("What is left of the reason's share; null if infinite.")
    apart: float | None = about(
        "Share by which it is apart from the model's motion at its finest step, or, against a row "
        "of the model, from that with the row's change; null if infinite."
    )
    before: float | None = about("The same of the model as it is; null if infinite.")
    price: BudgetPrice | None = about("Time with the change over time without; null if unknown.")
    lines: tuple[str, ...] = about("The lines of the model's files, each after FILE:LINE.")
    unwritten: str = about("Why there are no lines.", default="")

    @property
    def is_structural(self) -> bool:
        """Whether it changes joints, shapes, the start, or which pairs touch."""
        return bool(self.excluded or self.freed or self.fitted or self.posed)


class RunLabel(Model):
    """A label that runs of the task have."""

    label: str
    phase: str = about("In which it is first met.")
    runs: int = about("How many have it.")
    reason: str = about("Why it applies to the first of them.")
    seed: int = about("Of that run.")
    time: float | None = about("When it was first met [s]; null if of the whole run.")
    bodies: tuple[str, ...] = about(
        "Those that it is of; none if it is of the whole run.", default=()
    )

    @property
    def where(self) -> str:
        """The bodies that its reason does not name, after " of "; else empty."""
        named = any(body in self.reason for body in self.bodies)
        return f" of {', '.join(self.bodies)}" if self.bodies and not named else ""


class RestingContact(Model):
    """A monitored pair in units of the world, and what it bears at rest."""

    name: str
    solref: tuple[float, ...] = about("as the engine uses it")
    phase: str = about("the first of the task, at whose end it is measured")
    contacts: float = about("their mean number then; 0 if it does not rest", unit="1")
    load: float = about("that one of them bears", unit="N")
    depth: float = about("their mean depth, measured", unit="m")
    expected_depth: float | None = about("by the law of rest; null without a load", unit="m")
    stiffness: float = about("in an impact", unit="N/m")
    damping: float = about("in an impact", unit="N s/m")
    damping_ratio: float = about("of an impact", unit="1")
    restitution: float = about("of an impact without gravity, by the law", unit="1")
    bounced: float | None = about("restitution in the run; null if nothing bounced", unit="1")
    longest_step: float = about("timestep that resolves it", unit="s")
    timestep: float = about("of the run", unit="s")


class Examination(Model):
    """What is known of a model under its task: an error budget, and what runs and checks find."""

    model: str = about("The scene or model, as it was named.")
    mujoco: str = about("Version of MuJoCo.")
    task: Task
    sections: tuple[SectionName, ...] = about("Those that were asked for.")
    sentence: str = about(
        "The verdict in one sentence: what, where, when, and what removes it; empty if only "
        "contacts were asked for."
    )
    verdict: TaskVerdict | None = about(
        "The numerics of the task and the labels of its runs; null if these were not asked for.",
        default=None,
    )
    budget: BudgetReport | None = about(
        "Times in it count from the beginning of the phase. Without the section of this name, it "
        "has no rows; null if only contacts were asked for.",
        default=None,
    )
    labels: tuple[RunLabel, ...] = about("Those that runs have.", default=())
    facts: tuple[Fact, ...] = ()
    checks: tuple[CheckResult, ...] = ()
    findings: tuple[Finding, ...] = about("What was judged by checks, failures first.", default=())
    contacts: tuple[RestingContact, ...] = ()
    changes: tuple[ModelChange, ...] = about(
        "At most three, the cheapest first, those that `--accept` named, and what parts links.",
        default=(),
    )
    untried: tuple[str, ...] = about(
        "Rows of the budget, which judge nothing, and changes that were left out so that it ended "
        "within its CPU.",
        default=(),
    )
    notes: tuple[str, ...] = ()
    written: str | None = about("The changed model's file, if one was written.", default=None)
    evidence: str | None = about("Folder of its stores; null if they were not kept.", default=None)
    page: str | None = about("Its page; null if none was drawn.", default=None)

    @property
    def sound(self) -> bool:
        """True if the run is the motion of its model and has no label, as checks judge it.

        Checks that were chosen, and failures that are accepted, count for themselves. How soft the
        model is, is told and fails nothing: softness may be meant.
        """
        if self.findings:
            return all(finding.outcome != "failed" for finding in self.findings)
        words = [self.verdict.word] if self.verdict else []
        words += [self.budget.verdict] if self.budget else []
        labels = self.verdict.labels if self.verdict else {}
        return not labels and all(word in {None, "sound", "model"} for word in words)

    def _repr_html_(self) -> str:
        """Return the verdict, the shares of the worst phase, and what changes, for notebooks."""
        lines = [f"<strong>{escape(self.sentence)}</strong>", escape(self.task.line)]
        lines += [escape(fact.sentence) for fact in self.facts]
        lines += [escape(f"{label.label}{label.where}: {label.reason}") for label in self.labels]
        for change in self.changes:
            lines.append(f"{escape(change.name)}<pre>{escape(chr(10).join(change.lines))}</pre>")
        lines += [f'<a href="{escape(self.page)}">{escape(self.page)}</a>'] if self.page else []
        return "".join(f"<p>{line}</p>" for line in lines) + self._table()

    def _table(self) -> str:
        """Return the rows of the worst phase as a table of HTML."""
        phases = self.budget.phases if self.budget else ()
        if not phases:
            return ""
        worst = max(phases, key=lambda phase: phase.run.share or 0.0)
        rows = [row for row in (worst.run, *worst.rows) if row.exercised]
        cells = (
            (row.name, "∞" if row.share is None else f"{100 * row.share:.2g} %", row.body or "")
            for row in rows
        )
        body = (f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in cells)
        head = f"<tr><th>{escape(worst.name)}</th><th>share</th><th>worst body</th></tr>"
        return f"<table>{head}{''.join(body)}</table>"
