"""Results of an error budget: per row, per phase, and combined."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from contactlab.budget.windows import EngineWarning
from contactlab.contact.trace_arrays import Floats
from contactlab.modifications.modification import RowKind
from contactlab.schema.time_ratio import TimeRatio


@dataclass(frozen=True)
class Reading:
    """One row of a budget, over the seeds of a phase.

    Attributes:
        name, summary, kind: of the row.
        exercised: whether the task exercises the modified setting; if not, the errors are NaN.
        errors: (B,) of each body, the mean over seeds; infinite if the engine failed.
        seeds: (S,) error of the worst body in each seed.
        body: number of the worst body among the observed ones.
        speed: defect of that body, the mean over windows [m/s]; the speed of a creep.
        seed, time: window in which the defect of that body is largest, and when it begins [s].
        shares: (S, B) error of each body in each seed.
        place: contact, joint, tendon or equality whose impulse on that body differs most there;
            "" if this was not requested.
        time_ratio: time of a run with the change over one without; None if the change is not one
            of settings, or was not timed.
    """

    name: str
    summary: str
    kind: RowKind
    exercised: bool
    errors: Floats
    seeds: Floats
    body: int = 0
    speed: float = np.nan
    seed: int = 0
    time: float = np.nan
    place: str = ""
    time_ratio: TimeRatio | None = None
    shares: Floats = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def error(self) -> float:
        """Error of the worst body; NaN if the row is not exercised."""
        return float(self.errors[self.body]) if self.errors.size else float("nan")

    @property
    def median(self) -> float:
        """Median over the observed bodies."""
        return float(np.median(self.errors)) if self.errors.size else float("nan")


class Origin(NamedTuple):
    """The place and time of an energy drift."""

    body: str
    place: str  # the contact or joint that acts differently on the body; "" if none does
    time: float  # of the beginning of the window [s]


@dataclass(frozen=True)
class PhaseBudget:
    """A budget of one phase.

    Attributes:
        name: of the phase.
        timestep: of the run [s].
        steps: of each seed.
        window: length of windows [s].
        windows: number of windows of each seed.
        bodies: names of the B observed bodies, which move and have mass.
        masses: (B,) of these bodies [kg].
        run: numerical error: the run as written against the reference.
        rows: rows that the model has.
        energy: (S,) energy drift of the run and not of the reference, as a share.
        energy_rk4: (S,) the same against RK4; NaN if RK4 failed, or is the run's integrator.
        energy_origin: body whose kinetic energy the run changes most beyond the reference.
        excess_path: (B,) path of the run's velocity beyond the reference's, a share; not judged.
        worst_window: worst window over the body's own peak speed; not judged.
        upper_bound: largest numerical error that the convergence of the references allows: that of
            the run, or that at h/8 plus the difference of the references at h/4 and h/8. NaN
            without a check.
        limit_factor: factor of the errors of run and step, from a reference at h/4 to the limit of
            fine steps.
        invalid_windows: share of the windows in which the reference failed.
        warnings: of the engine, in the run.
    """

    name: str
    timestep: float
    steps: int
    window: float
    windows: int
    bodies: tuple[str, ...]
    masses: Floats
    run: Reading
    rows: tuple[Reading, ...]
    energy: Floats
    energy_rk4: Floats
    energy_origin: Origin
    excess_path: Floats
    worst_window: float
    upper_bound: float
    limit_factor: float
    invalid_windows: float
    warnings: tuple[EngineWarning, ...]

    def by_mass(self, reading: Reading) -> float:
        """Return the error of a row, weighted by mass."""
        if not reading.errors.size:
            return float("nan")
        return float((reading.errors * self.masses).sum() / self.masses.sum())

    def seeds_disagree(self, tolerance: float) -> bool:
        """Whether the numerical error of some seeds is above the tolerance, and of others not."""
        above = self.run.seeds > tolerance
        return bool(above.any() and not above.all())

    @property
    def doubt(self) -> float:
        """How far the numerical error may be above the measured one, a share; NaN if unchecked."""
        return self.upper_bound - self.run.error if np.isfinite(self.run.error) else 0.0

    @property
    def energy_drift(self) -> float:
        """The larger energy drift: the mean over seeds of the absolute drift.

        Its sign is that of the seed that drifts most, so that no gain hides the loss of another
        seed.
        """
        drifts = [
            float(np.copysign(np.abs(drift).mean(), drift[np.argmax(np.abs(drift))]))
            for drift in (self.energy, self.energy_rk4)
            if drift.size and not np.isnan(drift).any()
        ]
        return max(drifts, key=abs, default=0.0)


@dataclass(frozen=True)
class ErrorBudget:
    """Budgets of the phases of a task; each phase is judged alone."""

    phases: tuple[PhaseBudget, ...]

    def worst(self, name: str) -> tuple[PhaseBudget, Reading] | None:
        """Return the phase in which a row is largest, and its reading there."""
        readings = [
            (phase, reading)
            for phase in self.phases
            for reading in (phase.run, *phase.rows)
            if reading.name == name
        ]
        return max(readings, key=lambda pair: np.nan_to_num(pair[1].error, nan=-1.0), default=None)

    @property
    def error(self) -> float:
        """The numerical error of the worst body in the worst phase."""
        return max(phase.run.error for phase in self.phases)
