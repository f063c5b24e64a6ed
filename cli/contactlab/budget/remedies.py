"""What removes what a budget finds: changes of settings, each tried by a budget of its own."""

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import mujoco

from contactlab.budget.error_budget import SETTINGS, error_budget
from contactlab.budget.measuring import Settings
from contactlab.budget.motion import Motion
from contactlab.budget.prices import Price, prices
from contactlab.budget.readings import ErrorBudget
from contactlab.budget.rows import ROWS, Row, go_on, has_no_flex
from contactlab.budget.showing import shown_rows
from contactlab.budget.verdict import Reason, Verdict, Word, judge
from contactlab.budget.windows import replay
from contactlab.mjcf import OPTIONS
from contactlab.scene.model_edits import read_option

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_IMPLICITFAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)


@dataclass(frozen=True)
class Candidate:
    """A change of settings.

    Attributes:
        name: as a sentence has it: "half the step removes it".
        word: the verdict that it is against.
        change: of a copy of the model.
        rate: how many of its steps make one of the run's.
        rows: of the model, which it is worth trying against; any if empty.
        new: whether it changes a model at all.
        physics: whether it makes another model, not another computation of the same one.
        exercised: a row that the task must exercise; any or none if empty.
    """

    name: str
    word: Word
    change: Callable[[mujoco.MjModel], None]
    rate: int = 1
    rows: Sequence[str] = ()
    new: Callable[[mujoco.MjModel], bool] = lambda _model: True
    physics: bool = False
    exercised: str = ""


@dataclass(frozen=True)
class Remedy:
    """A change of settings that was tried.

    Attributes:
        name: of the change.
        removes: whether nothing is left of the kind of verdict that it was tried against.
        budget: of the changed model, under the same inputs.
        verdict: on that.
        physics: whether it makes another model, not another computation of the same one.
        options: the options that it changes, by name; all that it changes, unless it is of physics.
        row: the row of the model that it was tried against, or "run".
        price: its time over that of the model as it is.
    """

    name: str
    removes: bool
    budget: ErrorBudget
    verdict: Verdict
    price: Price | None
    physics: bool
    options: Mapping[str, object]
    row: str = "run"

    @property
    def share(self) -> float:
        """Of that row, in the worst phase; NaN where it is not exercised."""
        found = self.budget.worst(self.row)
        return found[1].share if found else float("nan")


def _nothing(_model: mujoco.MjModel) -> None:
    pass


def _integrator(kind: int) -> Callable[[mujoco.MjModel], None]:
    def change(model: mujoco.MjModel) -> None:
        model.opt.integrator = kind

    return change


def _is_not(kind: int) -> Callable[[mujoco.MjModel], bool]:
    """Return whether a model would have another integrator, which some refuse for flexes."""
    return lambda model: int(model.opt.integrator) != kind and has_no_flex(model)


def _noslip(model: mujoco.MjModel) -> None:
    model.opt.noslip_iterations = 10


def _stiff_friction(model: mujoco.MjModel) -> None:
    model.opt.cone = _ELLIPTIC
    model.opt.impratio = 10


def _as_row(row: Row, model: mujoco.MjModel) -> None:
    row.changes[0](model, model)


def _both(model: mujoco.MjModel) -> None:
    _stiff_friction(model)
    _noslip(model)


CANDIDATES: tuple[Candidate, ...] = (
    Candidate("Newton with 100 iterations", "unresolved", go_on, exercised="solver"),
    Candidate("implicitfast", "unresolved", _integrator(_IMPLICITFAST), new=_is_not(_IMPLICITFAST)),
    Candidate("Euler", "unresolved", _integrator(_EULER), new=_is_not(_EULER)),
    Candidate("half the step", "unresolved", _nothing, 2),
    Candidate(
        "implicitfast at half the step",
        "unresolved",
        _integrator(_IMPLICITFAST),
        2,
        new=_is_not(_IMPLICITFAST),
    ),
    Candidate("RK4", "unresolved", _integrator(_RK4), new=_is_not(_RK4)),
    Candidate("a quarter of the step", "unresolved", _nothing, 4),
    Candidate("an eighth of the step", "unresolved", _nothing, 8),
    Candidate("elliptic cones with impratio 10", "model", _stiff_friction),
    Candidate("elliptic cones with impratio 10, and noslip", "model", _both, new=has_no_flex),
    *(
        Candidate(
            row.summary,
            "model",
            partial(_as_row, row),
            rows=(row.name,),
            physics=row.name.endswith("softness"),
        )
        for row in ROWS
        if row.kind == "model"
    ),
)


def remedies(
    motions: Sequence[Motion],
    verdict: Verdict,
    *,
    settings: Settings = SETTINGS,
    candidates: Sequence[Candidate] = CANDIDATES,
    workers: int | None = None,
) -> tuple[Remedy, ...]:
    """Try changes against a verdict; those that remove it come first, the cheapest leading.

    A change removes a verdict if a budget of the changed model, over the same inputs and phases,
    gives neither the same word nor a worse one. Give motions with other seeds than those that were
    judged to have a remedy proved on what it was not chosen for.
    """
    if verdict.word == "sound":
        return ()
    word: Word = "model" if verdict.word == "model" else "unresolved"
    rows = sorted({reason.row for reason in verdict.reasons if reason.word == "model"})
    plain = replace(settings, places=False, priced=False)
    tried = list[Remedy]()
    for candidate in candidates:
        if candidate.word != word or (candidate.rows and not {*candidate.rows} & {*rows}):
            continue
        if not all(candidate.new(motion.model) for motion in motions):
            continue
        if candidate.exercised and not _exercised(candidate.exercised, motions):
            continue
        changed = [_changed(motion, candidate) for motion in motions]
        budget = error_budget(
            changed, rows=rows if word == "model" else (), settings=plain, workers=workers
        )
        found = judge(budget, verdict.within)
        removes = found.word == "sound" or (word == "unresolved" and found.word == "model")
        price = _price(motions[0], changed[0].model, candidate, settings)
        row = verdict.reasons[0].row if word == "model" else "run"
        options = _options(motions[0].model, changed[0].model)
        remedy = Remedy(
            candidate.name, removes, budget, found, price, candidate.physics, options, row
        )
        tried.append(remedy)
    return tuple(
        sorted(tried, key=lambda one: (not one.removes, one.price.ratio if one.price else 0))
    )


def _options(model: mujoco.MjModel, changed: mujoco.MjModel) -> dict[str, object]:
    """Return the options of a changed model that differ from those of another."""
    values = {name: read_option(changed, name) for name in OPTIONS}
    return {name: value for name, value in values.items() if value != read_option(model, name)}


def _exercised(name: str, motions: Sequence[Motion]) -> bool:
    (row,) = (row for row in ROWS if row.name == name)
    return any(row.uses(motion.model) and shown_rows(motion, [row]) for motion in motions)


def _changed(motion: Motion, candidate: Candidate) -> Motion:
    model = copy.copy(motion.model)
    candidate.change(model)
    model.opt.timestep = motion.model.opt.timestep / candidate.rate
    return replace(motion, model=model, inputs=motion.inputs.repeat(candidate.rate, axis=1))


def _price(
    motion: Motion, model: mujoco.MjModel, candidate: Candidate, settings: Settings
) -> Price | None:
    run = replay(motion, settings.window, 1)
    return prices(motion, run, {candidate.name: (model, candidate.rate)}).get(candidate.name)


def sentence(reason: Reason, tried: Sequence[Remedy]) -> str:
    """Return a reason with what removes it, and its price."""
    found = [remedy for remedy in tried if remedy.removes]
    if not found:
        names = ", ".join(remedy.name for remedy in tried)
        return f"{reason.sentence}; none removes it of {names}" if names else reason.sentence
    price = found[0].price
    cost = f", at {price.ratio:.2g} times the cost" if price else ""
    return f"{reason.sentence}; {found[0].name} removes it{cost}"
