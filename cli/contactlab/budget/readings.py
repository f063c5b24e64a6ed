"""What a budget is made of: readings of rows, phases, and what both say together."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from contactlab.budget.prices import Price
from contactlab.budget.rows import Kind
from contactlab.budget.windows import EngineWarning
from contactlab.contact.trace_arrays import Floats


@dataclass(frozen=True)
class Reading:
    """One row of a budget, over the seeds of a phase.

    Attributes:
        name, summary, kind: the row's.
        exercised: whether the task makes use of what is changed; without, the shares are NaN.
        shares: (B,) of each body, the mean over seeds; infinite where the engine gave up.
        seeds: (S,) the worst body's in each seed.
        body: the number of the worst body among those that are judged.
        speed: that body's defect, the mean over windows [m/s]; of what creeps, how fast.
        seed, time: the window in which that body's defect is largest, and when it begins [s].
        place: the contact, joint, tendon or equality whose impulse on that body differs most there;
            "" where that was not asked for.
        price: what the change costs in the model's own settings; None where it is no change of
            settings, or was not asked for.
    """

    name: str
    summary: str
    kind: Kind
    exercised: bool
    shares: Floats
    seeds: Floats
    body: int = 0
    speed: float = np.nan
    seed: int = 0
    time: float = np.nan
    place: str = ""
    price: Price | None = None

    @property
    def share(self) -> float:
        """Of the worst body; NaN where nothing was exercised."""
        return float(self.shares[self.body]) if self.shares.size else float("nan")

    @property
    def median(self) -> float:
        """Of all judged bodies."""
        return float(np.median(self.shares)) if self.shares.size else float("nan")


class Origin(NamedTuple):
    """Where something comes from: a body, a place that acts on it otherwise ("" if none), when."""

    body: str
    place: str
    time: float  # of the beginning of the window [s]


@dataclass(frozen=True)
class PhaseBudget:
    """A budget of one phase.

    Attributes:
        name: of the phase.
        timestep: of the run [s].
        steps: of each seed.
        window: length of windows [s].
        windows: how many each seed has.
        bodies: names of the B bodies that are judged: those that move and have mass, and are
            watched.
        masses: (B,) theirs [kg].
        run: the run itself against the reference: what its numerics cost.
        rows: those that the model has.
        energy: (S,) what energy drifts in the run and not in the reference, as a share.
        energy_rk4: (S,) the same against RK4; NaN where that gave up, or is the run's own.
        energy_from: whose kinetic energy the run changes most beyond the reference.
        excess: (B,) path of the run's velocity beyond the reference's, a share; judges nothing.
        peak: worst window over the body's own peak speed; judges nothing.
        most: the run's share, or that at h/8 and what references at h/4 and h/8 are apart, where
            that is more: how far off it may be as far as these are known. NaN without a check.
        limit: what the shares of the run and the step were multiplied by, from a reference at h/4
            to the limit of fine steps.
        lost: share of windows in which the reference itself gave up.
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
    energy_from: Origin
    excess: Floats
    peak: float
    most: float
    limit: float
    lost: float
    warnings: tuple[EngineWarning, ...]

    def by_mass(self, reading: Reading) -> float:
        """Return the share of a row, weighted by mass."""
        if not reading.shares.size:
            return float("nan")
        return float((reading.shares * self.masses).sum() / self.masses.sum())

    @property
    def energy_share(self) -> float:
        """The larger drift of energy: the mean of what seeds gain or lose.

        Its sign is that of the seed that drifts most, so that no gain hides another seed's loss.
        """
        found = [
            float(np.copysign(np.abs(drift).mean(), drift[np.argmax(np.abs(drift))]))
            for drift in (self.energy, self.energy_rk4)
            if drift.size and not np.isnan(drift).any()
        ]
        return max(found, key=abs, default=0.0)


@dataclass(frozen=True)
class ErrorBudget:
    """Budgets of the phases of a task, each judged by itself."""

    phases: tuple[PhaseBudget, ...]

    def worst(self, name: str) -> tuple[PhaseBudget, Reading] | None:
        """Return the phase in which a row is largest, or "run", and its reading there."""
        found = [
            (phase, reading)
            for phase in self.phases
            for reading in (phase.run, *phase.rows)
            if reading.name == name
        ]
        return max(found, key=lambda pair: np.nan_to_num(pair[1].share, nan=-1.0), default=None)

    @property
    def share(self) -> float:
        """The backward error: of the worst body in the worst phase."""
        return max(phase.run.share for phase in self.phases)
