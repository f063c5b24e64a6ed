"""Modifications that compute the same model in another way."""

import math

import mujoco

from contactlab.modifications.model_changes import (
    DENSE_UP_TO,
    choose_other_integrator,
    choose_other_solver,
    converge_solver,
    converge_solver_alone,
    has_branches,
    keep_awake,
    keep_model,
    raise_time_constants,
    set_integrator,
    set_option,
)
from contactlab.modifications.model_predicates import (
    SLEEP_BIT,
    SOLREF_FIELDS,
    has_constraints,
    has_flag,
    has_no_flex,
    may_sleep,
    raises_time_constants,
)
from contactlab.modifications.modification import (
    ANY_LABEL,
    Candidate,
    Feature,
    Lever,
    ModelPredicate,
    Modification,
    PartFix,
    Row,
    Settings,
)
from contactlab.modifications.state_predicates import (
    has_constraint,
    has_sleeping_tree,
    loads_raised_constant,
)
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.parameters import WORDS
from contactlab.scene.variants import Variant

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_IMPLICITFAST = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICIT)
_PART_SOLREF_FIELDS = tuple(field for field in SOLREF_FIELDS if field != "flex_solref")
"""Fields of solref of parts that a setting can name."""
ENERGY_LABELS = ("energy_injection", "energy_loss")


def _is_not(kind: int) -> ModelPredicate:
    # Flexes allow no other integrator.
    return lambda model: int(model.opt.integrator) != kind and has_no_flex(model)


def _may_sleep(model: mujoco.MjModel) -> bool:
    return bool(model.opt.enableflags & SLEEP_BIT)


def _words_of(name: str) -> tuple[str, ...]:
    return tuple(word for word in WORDS[name] if word != "auto")


def _takes_sparse_jacobian(model: mujoco.MjModel) -> bool:
    return bool(mujoco.mj_isSparse(model)) and has_branches(model) and model.nv <= DENSE_UP_TO


def _use_dense_jacobian(model: mujoco.MjModel) -> None:
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _has_islands(_model: mujoco.MjModel) -> bool:
    return "island" in FLAG_NAMES


_FEW_ITERATIONS = 20
"""Solver and line search iterations below this may be too few at longer steps."""
SLEEP_SETTINGS: Settings = {"sleep": True, "island": True}
"""Sleep needs islands."""
RUN = Row(
    "numerical error", "the run as written", "numerics", (keep_model,), base="run", has_time=False
)
"""The first row of every budget, which changes nothing."""
HALF_STEP = Candidate("half the step", "inaccurate", rate=2, labels=(ANY_LABEL,))
CONVERGED_SOLVER = Candidate(
    "Newton with 100 iterations",
    "inaccurate",
    converge_solver,
    exercised="solver",
    labels=("solver_nonconvergence", "solver_inconsistent"),
)
RUNGE_KUTTA = Candidate(
    "RK4",
    "inaccurate",
    set_integrator(_RK4),
    applies=_is_not(_RK4),
    labels=ENERGY_LABELS,
    label_applies=_is_not(_RK4),
    order=1,  # it takes four evaluations of forces in a step
)

MODIFICATIONS = (
    Modification(
        "timestep",
        "Takes shorter or longer time steps.",
        ("timestep",),
        "computation",
        rows=(
            Row(
                "step",
                "the run's timestep, with a solver that goes on until it is done",
                "numerics",
                (keep_model,),
                base="step",
                has_time=False,
                cause="the time step is too long",
            ),
        ),
        fixes=(
            HALF_STEP,
            Candidate("a quarter of the step", "inaccurate", rate=4, labels=(ANY_LABEL,)),
            Candidate("an eighth of the step", "inaccurate", rate=8, labels=(ANY_LABEL,)),
        ),
        variants=(
            Variant(
                "half the step",
                "two steps for each, at the same control rate",
                "numerics",
                applies=has_no_flex,
                rate=2,
            ),
            Variant(
                "a quarter of the step",
                "four steps for each, at the same control rate",
                "numerics",
                applies=has_no_flex,
                rate=4,
            ),
        ),
    ),
    Modification(
        "solver",
        "Uses another constraint solver, or lets it run to convergence.",
        ("solver", "iterations", "ls_iterations", "tolerance"),
        "computation",
        rows=(
            Row(
                "solver",
                "the run's own solver, iterations and tolerance",
                "numerics",
                (converge_solver_alone,),
                has_constraints,
                has_constraint,
                base="step",
                against="run",
                cause="the solver stops too early",
            ),
        ),
        fixes=(CONVERGED_SOLVER,),
        levers=(Lever("solver", _words_of("solver"), cost_falls=False),),
        variants=(
            Variant(
                "other solver",
                "Newton, or CG in place of Newton, with 100 iterations",
                "numerics",
                choose_other_solver,
                has_constraints,
            ),
        ),
    ),
    Modification(
        "jacobian",
        "Stores the constraint Jacobian as a dense or a sparse matrix.",
        ("jacobian",),
        "computation",
        fixes=(
            Candidate(
                "a dense Jacobian",
                "inaccurate",
                _use_dense_jacobian,
                applies=_takes_sparse_jacobian,
                exercised="solver",
                labels=("solver_inconsistent",),
                label_applies=_takes_sparse_jacobian,
                order=-1,  # it computes the same steps
            ),
        ),
        levers=(Lever("jacobian", _words_of("jacobian"), cost_falls=False),),
    ),
    Modification(
        "solver iterations",
        "Bounds the iterations of the constraint solver.",
        ("iterations",),
        "computation",
        levers=(
            Lever(
                "iterations",
                (50, 20, 10, 5, 3),
                "below",
                rows=("solver",),
                step_sensitive_below=_FEW_ITERATIONS,
                order=1,
            ),
        ),
    ),
    Modification(
        "line search iterations",
        "Bounds the iterations of the line search.",
        ("ls_iterations",),
        "computation",
        levers=(
            Lever(
                "ls_iterations",
                (20, 10, 5),
                "below",
                step_sensitive_below=_FEW_ITERATIONS,
                order=1,
            ),
        ),
    ),
    Modification(
        "solver tolerance",
        "Ends the solver at a larger improvement.",
        ("tolerance",),
        "computation",
        levers=(Lever("tolerance", (1e-8, 1e-6, 1e-4), "above", order=2),),
    ),
    Modification(
        "islands",
        "Solves groups of bodies that touch alone, or all together.",
        ("island",),
        "computation",
        levers=(Lever("island", (True, False), applies=_has_islands, order=3),),
        features=(Feature("island"),),
    ),
    Modification(
        "eulerdamp",
        "Integrates joint damping implicitly in the Euler integrator.",
        ("eulerdamp",),
        "computation",
        # Damping costs accuracy in proportion to the step.
        levers=(
            Lever(
                "eulerdamp",
                (False,),
                applies=has_flag("eulerdamp"),
                step_sensitive_below=math.inf,
                order=4,
            ),
        ),
        features=(Feature("eulerdamp"),),
    ),
    Modification(
        "sleep",
        "Lets bodies at rest sleep, or keeps all bodies awake.",
        ("sleep", "island"),
        "computation",
        rows=(
            Row(
                "sleep",
                "bodies that do not sleep",
                "numerics",
                (keep_awake,),
                lambda model: bool(model.opt.enableflags & SLEEP_BIT),
                has_sleeping_tree,
                base="run",
                against="run",
                cause="bodies sleep that should move",
            ),
        ),
        fixes=(
            Candidate(
                "no sleep",
                "inaccurate",
                keep_awake,
                applies=_may_sleep,
                labels=("asleep_unsupported",),
                must_come_nearer=False,  # windows begin awake, so that they do not show sleep
                order=-1,  # it takes no more time than bodies that should move
            ),
        ),
        levers=(
            Lever(
                "sleep",
                (True,),
                applies=may_sleep,
                search="runs",
                write=lambda _model, _value: SLEEP_SETTINGS,
            ),
        ),
        features=(Feature("sleep", on=SLEEP_SETTINGS),),
    ),
    Modification(
        "sleep tolerance",
        "Lets faster bodies fall asleep.",
        ("sleep_tolerance",),
        "computation",
    ),
    Modification(
        "integrator",
        "Uses another integrator.",
        ("integrator",),
        "computation",
        rows=(
            Row(
                "integrator",
                "implicitfast in place of the run's integrator; Euler in place of implicitfast",
                "numerics",
                (set_option("integrator", choose_other_integrator),),
                has_no_flex,
                base="step",
                against="step",
            ),
        ),
        fixes=(
            Candidate(
                "implicitfast",
                "inaccurate",
                set_integrator(_IMPLICITFAST),
                applies=_is_not(_IMPLICITFAST),
            ),
            Candidate("Euler", "inaccurate", set_integrator(_EULER), applies=_is_not(_EULER)),
            Candidate(
                "implicitfast at half the step",
                "inaccurate",
                set_integrator(_IMPLICITFAST),
                2,
                applies=_is_not(_IMPLICITFAST),
                includes=("implicitfast", "half the step"),
            ),
            # A stiff servo in the air needs its damping implicit, an impact a short step.
            *(
                Candidate(
                    f"implicitfast at {part} of the step",
                    "inaccurate",
                    set_integrator(_IMPLICITFAST),
                    rate,
                    applies=_is_not(_IMPLICITFAST),
                    stage="further",
                )
                for part, rate in (("a quarter", 4), ("an eighth", 8))
            ),
            RUNGE_KUTTA,
            # Gyroscopic forces are explicit in implicitfast as in Euler.
            Candidate(
                "implicit",
                "inaccurate",
                set_integrator(_IMPLICIT),
                applies=_is_not(_IMPLICIT),
                stage="further",
            ),
        ),
        levers=(
            Lever(
                "integrator",
                ("Euler", "implicitfast", "implicit", "RK4"),
                applies=has_no_flex,
                search="step",
            ),
        ),
        features=(Feature("implicit", on={"implicit": True}),),
    ),
    Modification(
        "refsafe",
        "Raises time constants to two steps at least, or writes the raised ones into the model.",
        ("refsafe", *_PART_SOLREF_FIELDS),
        "model",
        safeguard=True,
        rows=(
            Row(
                "refsafe",
                "time constants as the run's step has them raised",
                "numerics",
                (raise_time_constants,),
                raises_time_constants,
                loads_raised_constant,
                has_time=False,
            ),
        ),
        part_fixes=(PartFix("solref-step", _PART_SOLREF_FIELDS, exercised="refsafe"),),
        features=(Feature("refsafe"),),
    ),
    Modification(
        "warm start",
        "Starts the solver from nothing, not from the solution of the last step.",
        ("warmstart",),
        "computation",
        safeguard=True,
        features=(Feature("warmstart"),),
    ),
)
