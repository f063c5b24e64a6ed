"""The type of a modification: one entry of the catalogue, with its use by each command.

An entry names a thing that can be changed in a model. Rows of the error budget, fixes, levers of
the search, features and parts that are left out, and fixes of a grip are uses of it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from contactlab.scene.model_draft import ModelEdits, object_name
from contactlab.scene.variants import Variant
from contactlab.schema.effects_report import PartKind
from contactlab.schema.verdict import VerdictWord

ModelChange = Callable[[mujoco.MjModel, mujoco.MjModel], None]
"""Changes a copy of a model in place. The second argument is the model as written."""
InPlaceChange = Callable[[mujoco.MjModel], None]
"""Changes a copy of a model in place, whatever the model as written is."""
ModelPredicate = Callable[[mujoco.MjModel], bool]
StatePredicate = Callable[[mujoco.MjModel, mujoco.MjData], bool]
"""Returns whether a state after a step loads a setting, so that its change can matter."""
Settings = Mapping[str, object]
"""Values by the names of settings, as in a sweep."""
RowKind = Literal["numerics", "model", "effect", "unknown"]
Kind = Literal["computation", "model"]
NO_EDITS = ModelEdits()
ANY_LABEL = "any"
"""Stands for all labels, in the labels of a fix."""


def applies_to_all(model: mujoco.MjModel, data: mujoco.MjData | None = None) -> bool:  # noqa: ARG001
    """Return True for every model, and for every state of it."""
    return True


@dataclass(frozen=True)
class Row:
    """A row of the error budget.

    Attributes:
        name: in tables and options.
        summary: the change, in a few words.
        kind: numerics (of the run's own step) and model (how rigid and how regularized) decide the
            verdict; effect (left out) and unknown (a parameter that is not known exactly) are
            printed, and `tune` prints unknown ones as the model's own uncertainty.
        changes: one or two, each makes a variation in a copy of the compared model; the largest
            counts. The first of two is more, the second less.
        applies: whether a model has the setting; otherwise it has no such row.
        is_loaded: whether a state after a step loads the setting.
        base: the changed settings: those of the reference, of the run's step with a converged
            solver, or of the run.
        against: the settings to compare with: one of these.
        both: a change of both sides that comes first, if any.
        has_time: whether the change could be made in the model's own settings.
        subject: the modeling choice, as in "depends on the friction cone".
        alternative: the change, as in "an elliptic cone changes thigh's motion".
        cause: a sentence for a numerical error that this row alone causes.
    """

    name: str
    summary: str
    kind: RowKind
    changes: Sequence[ModelChange]
    applies: ModelPredicate = applies_to_all
    is_loaded: StatePredicate = applies_to_all
    base: Literal["run", "step", "reference"] = "reference"
    against: Literal["run", "step", "reference"] = "reference"
    both: ModelChange | None = None
    has_time: bool = True
    subject: str = ""
    alternative: str = ""
    cause: str = ""

    @property
    def is_of_steps(self) -> bool:
        """Whether it says how far the run's steps are from the limit of fine ones."""
        return self.base != "reference" and self.against == "reference"


class FieldValue(NamedTuple):
    """A value of a model's field, and its place there.

    Attributes:
        field: of the compiled model.
        place: index in the field.
        axis: setting that writes it, such as dof_armature[left_knee].
        value: a number, or a row of numbers.
    """

    field: str
    place: tuple[int, ...]
    axis: str
    value: float | tuple[float, ...]


def leave_unchanged(_model: mujoco.MjModel) -> None:
    """Change nothing in a model."""


@dataclass(frozen=True)
class Candidate:
    """A change of a model that may be a fix.

    Attributes:
        name: as in "fix: half the step".
        word: the verdict that it may remove.
        change: changes a copy of the model in place.
        rate: number of its steps per step of the run.
        rows: modeling choices that it may help with; any if empty.
        applies: whether it changes a model at all.
        exercised: a row that the task must exercise; no condition if empty.
        apply: name for `--apply`, if it makes another model instead of computing the same one
            differently; otherwise empty.
        edits: how another model is written.
        values: the values of fields that it writes, if it does nothing else.
        compiled: the changed model, if a copy of the model cannot be edited into it.
        must_come_nearer: whether it has to come nearer to the model's motion at its finest step.
        includes: names of fixes that it includes; if one of them is enough, it is not tried.
        labels: labels of runs that it may remove; ANY_LABEL for all.
        label_applies: whether it is tried against labels in a model.
        missed: the fault of collision that it removes, in a sentence; empty if it changes no
            detection of contacts.
        stage: whether it is tried at once, or only if all usual candidates fail.
        order: trials go by it, then by rate, then in the order of the catalogue.
    """

    name: str
    word: VerdictWord
    change: InPlaceChange = leave_unchanged
    rate: int = 1
    rows: Sequence[str] = ()
    applies: ModelPredicate = applies_to_all
    exercised: str = ""
    apply: str = ""
    edits: ModelEdits = NO_EDITS
    values: Sequence[FieldValue] = ()
    compiled: mujoco.MjModel | None = None
    must_come_nearer: bool = True
    includes: Sequence[str] = ()
    labels: Sequence[str] = ()
    label_applies: ModelPredicate = applies_to_all
    missed: str = ""
    stage: Literal["usual", "further"] = "usual"
    order: int = 0

    @property
    def changes_model(self) -> bool:
        """Whether it makes another model."""
        return bool(self.apply)

    @property
    def same_states(self) -> bool:
        """Whether the changed model can begin in the states of the original one."""
        return not (self.edits.freed or self.edits.moves_start)


@dataclass(frozen=True)
class PartFix:
    """A fix of parts of a model: the verdict, the labels or the start select them.

    Attributes:
        apply: name for `--apply`; numbers and `-all` follow it for further values and parts.
        fields: fields of a compiled model that it changes, or elements of its file.
        labels: labels of runs that it may remove.
        exercised: a row that the task must exercise; no condition if empty.
        rows: modeling choices that it may help with; any if empty.
    """

    apply: str
    fields: Sequence[str]
    labels: Sequence[str] = ()
    exercised: str = ""
    rows: Sequence[str] = ()


@dataclass(frozen=True)
class Lever:
    """A setting that the search of `tune` may change to save time.

    Attributes:
        setting: its name, also in reports.
        domain: values to try, in this order.
        direction: whether only values below, or above, that of the model are tried.
        applies: whether it is tried for a model.
        rows: rows of the error budget; the task must load one of them.
        load: their load, in words.
        step_sensitive_below: values below it depend on the step, and are tried once that is found.
        cost_falls: whether each value costs no more than those before it, so that no value saves
            time if the last one does not.
        search: whether its values are tried alone, with each step, or in whole runs.
        write: returns the settings that write a value into a model; by default the setting itself.
        order: levers go by it, then in the order of the catalogue.
    """

    setting: str
    domain: Sequence[object]
    direction: Literal["other", "below", "above"] = "other"
    applies: ModelPredicate = applies_to_all
    rows: Sequence[str] = ()
    load: str = ""
    step_sensitive_below: float = -math.inf
    cost_falls: bool = True
    search: Literal["values", "step", "runs"] = "values"
    write: Callable[[mujoco.MjModel, object], Settings] | None = None
    order: int = 0


ReductionName = Literal["unused", "far-pairs", "hulls", "sensors"]


@dataclass(frozen=True)
class Reduction:
    """Parts that `tune` leaves out in addition to its settings.

    Attributes:
        name: for `--apply`, unless it is always tried.
        is_exact: whether no state depends on the parts, so that it is tried without `--apply`.
        distance: default of `--apply NAME=LENGTH` [m]; None for a name without a length.
    """

    name: ReductionName
    is_exact: bool = False
    distance: float | None = None


@dataclass(frozen=True)
class Feature:
    """A feature that `effects` leaves out of a model as a whole, or adds to it.

    Attributes:
        name: in reports; that of the effect, if sweeps can switch it.
        applies: whether a model may have it.
        off: values of axes that leave it out; by default its own axis.
        on: values of axes that add it; empty if studies do not.
        fields: fields that become 0 for each object with another value, in place of `off`.
        safeguard: whether it may carry loads that a task does not show, so that it stays.
    """

    name: str
    applies: ModelPredicate = applies_to_all
    off: Settings = field(default_factory=dict[str, object])
    on: Settings = field(default_factory=dict[str, object])
    fields: Sequence[str] = ()
    safeguard: bool = False

    @property
    def off_values(self) -> Settings:
        """The values of axes that leave it out of any model."""
        return self.off or {self.name: False}

    def settings_without(self, model: mujoco.MjModel) -> Settings:
        """Return the settings that leave it out of a model; none if the model has nothing of it."""
        if not self.applies(model):
            return {}
        if not self.fields:
            return self.off_values
        return {
            f"{name}[{object_name(model, name, int(row))}]": 0.0
            for name in self.fields
            for row in np.flatnonzero(getattr(model, name, ()))
        }


@dataclass(frozen=True)
class PartRemoval:
    """How single parts of a model are removed.

    Attributes:
        kind: of the part, in reports.
        fields: of the compiled model that become 0; those that this MuJoCo lacks are left out.
            Without fields, their elements are removed.
        find_parts: returns the ids of the parts in a model.
    """

    kind: PartKind
    fields: Sequence[str]
    find_parts: Callable[[mujoco.MjModel], Sequence[int]]


@dataclass(frozen=True)
class GripFix:
    """A fix of a grip.

    Attributes:
        find_name: returns its name for a model.
        against: the cause that it tests.
        change: changes a copy of the model; the geoms are those of the hand that touch the object.
            None for a control of the hand.
        fields: fields of geoms that it changes.
        is_both: whether it combines two others.
    """

    find_name: Callable[[mujoco.MjModel], str]
    against: str
    change: Callable[[mujoco.MjModel, Sequence[int]], None] | None
    fields: tuple[str, ...] = ()
    is_both: bool = False


@dataclass(frozen=True)
class Modification:
    """An entry of the catalogue.

    Attributes:
        name: unique in the catalogue.
        summary: a sentence for a reader.
        edits: settings by the names of sweeps, fields of a compiled model, or elements of its file.
        kind: whether it computes the same model in another way, or makes another model.
        safeguard: whether it protects runs that a task does not show, so that it is not removed.
        rows: its rows of the error budget.
        fixes: its fixes that are the same for every model.
        part_fixes: its fixes of some parts of a model.
        levers: its settings in the search of `tune`.
        features: its features that `effects` leaves out, or adds, as a whole.
        removals: its parts that `effects` removes one by one.
        reductions: its parts that `tune` leaves out.
        grip_fixes: its fixes of a grip.
        variants: its variants of an episode, for `success`.
    """

    name: str
    summary: str
    edits: Sequence[str]
    kind: Kind
    safeguard: bool = False
    rows: Sequence[Row] = ()
    fixes: Sequence[Candidate] = ()
    part_fixes: Sequence[PartFix] = ()
    levers: Sequence[Lever] = ()
    features: Sequence[Feature] = ()
    removals: Sequence[PartRemoval] = ()
    reductions: Sequence[Reduction] = ()
    grip_fixes: Sequence[GripFix] = ()
    variants: Sequence[Variant] = ()

    @property
    def answered_rows(self) -> tuple[str, ...]:
        """Names of the rows of the error budget that it answers."""
        own = [row.name for row in self.rows]
        uses = (*self.fixes, *self.part_fixes, *self.levers)
        others = [row for use in uses for row in use.rows]
        return tuple(dict.fromkeys([*own, *others]))

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of runs that it may remove."""
        uses = (*self.fixes, *self.part_fixes)
        return tuple(dict.fromkeys(label for use in uses for label in use.labels))
