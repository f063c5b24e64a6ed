"""The report of `contactlab tune`: the front of accuracy and time, and the recommendation."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about
from contactlab.schema.task import Task
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.verification import VerifiedChange

REPORT, MODEL, FOLDER = "tune.json", "tuned.xml", "tuned"
PATCH = f"{FOLDER}/tuned.patch"
"""Files of the study's folder. The model is in `tuned`, with the files that it refers to."""
EQUAL_ERROR_FOLDER = "equal_error"
"""Folder of a model that is as accurate as the model as written, if that one is not ok."""
POINT_FOLDER = "point{number}"
"""Folder of a point of the front that was requested."""

TargetKind = Literal["as written", "tolerance", "error", "real time", "forward error"]
SearchEnd = Literal["complete", "work", "time"]
PointState = Literal["as written", "verified", "failed", "not verified"]


class Target(Model):
    """The goal of the search."""

    kind: TargetKind = about(
        "as written: the fastest that is no less accurate than the model as written; tolerance: "
        "the fastest within the tolerance, since the model as written is not; error: the fastest "
        "whose error is at most the requested one; real time: the most accurate that is fast "
        "enough; forward error: the fastest whose forward error is at most the requested one."
    )
    limit: float = about("Largest error: a share of the real forces, or in `unit`.")
    unit: str = about("Unit of errors: 1 (a share), m, or the unit of a sensor.")
    tolerance: float = about("The tolerance, a share of the real forces.")
    real_time: FiniteOrNull = about("Requested simulated time over CPU time.")
    observed: tuple[str, ...] = about("Bodies, sites and sensors of a forward error.")
    error_at: Literal["end", "peak"] | None = about("When the forward error is measured.")
    divergence: str = about("How nudged copies diverge; empty without a forward error.")
    chance: float = about(
        "How much larger the error of an equal chaotic motion may be: the standard deviation of "
        "the error as written over seeds; 0 if the motion is not chaotic."
    )


class Candidate(Model):
    """Settings that were measured."""

    settings: dict[str, Setting] = about("Settings that differ from the model as written.")
    timestep: float = about("s")
    removes_unused: bool = about("Without anything that changes no state: see the report.")
    removes_far_pairs: bool = about("Without collisions of far pairs: see the report.")
    simplifies_hulls: bool = about("With fewer vertices of hulls: see the report.")
    error: FiniteOrNull = about(
        "Error of the worst body, mean over seeds of the task; null if MuJoCo gave up. Points of "
        "the front have that of `contactlab MODEL`; the others an estimate from states of the "
        "reference."
    )
    low: FiniteOrNull = about("Least error of any seed.")
    high: FiniteOrNull = about("Largest error of any seed.")
    body: str = about("The worst body.")
    phase: str
    time: FiniteOrNull = about("When its worst window begins [s since the phase began].")
    exact: bool = about("Whether each bit of the task's motion is that of the model as written.")
    cost: FiniteOrNull = about(
        "Counted work per simulated second, over that of the model as written; null if infinite. "
        "It is the same on any machine, and decides the search."
    )
    time_ratio: TimeRatio | None = about(
        "Measured time over the time of the model as written; only of points of the front. That of "
        "the model as written against itself shows the noise. Null if it was not measured."
    )


class Verification(Model):
    """A written candidate on seeds that the search did not use."""

    seeds: tuple[int, ...]
    holds: bool
    meets_target: bool = about(
        "Whether it also meets the target, if the recommended candidate need not."
    )
    error: FiniteOrNull = about("Forward error on these seeds, if one is requested.")
    current_error: FiniteOrNull = about("The same error of the model as written.")
    verdict: str = about("The verdict of `contactlab MODEL` on its numerics.")
    numerical_error: FiniteOrNull = about(
        "Its numerical error as `contactlab MODEL` measures it, on the seeds of the task; null if "
        "it was rejected before."
    )
    labels: tuple[str, ...] = about("Labels of its runs that the model as written does not have.")
    sentence: str = about("Why it does not hold, or that it does.")
    panel: VerifiedChange | None = about(
        "Each measure next to that of the model as written; null if the candidate was rejected "
        "before, or moves exactly as the model as written.",
        default=None,
    )


class CurrentVerdict(Model):
    """The verdict of `contactlab MODEL` on the numerics of the model as written."""

    seeds: tuple[int, ...] = about("Seeds of the task.")
    verdict: str
    numerical_error: FiniteOrNull = about("Its numerical error, mean over these seeds.")


class ChangedSetting(Model):
    """A changed setting, and its value before."""

    name: str
    before: Setting
    after: Setting


class SkippedSetting(Model):
    """A setting that was not changed, and why."""

    name: str
    reason: str


class PatchedLine(Model):
    """A line of a model file after the patch; empty if the patch removes it."""

    file: str
    line: int
    element: str


class AlternativeCandidate(Model):
    """Another candidate besides the recommended one, written and verified in the same way."""

    candidate: Candidate
    changed_settings: tuple[ChangedSetting, ...]
    verified: Verification
    file: str = about("The written model, relative to the report.")


class FrontPoint(Model):
    """A point of the front: no measured candidate is both more accurate and faster."""

    number: int = about("From the most accurate on, as in `--pick`.")
    name: str = about("Integrator and timestep, with a setting if another point has the same.")
    marks: tuple[str, ...] = about("as written, recommended, equal error, or none.")
    candidate: Candidate
    error: FiniteOrNull = about(
        "Numerical error, mean over `error_seeds` seeds: those of the task, as in the `error` of "
        "the candidate, and fresh ones. Or the largest forward error on seeds that the search did "
        "not use. Null if MuJoCo gave up."
    )
    error_low: FiniteOrNull = about(
        "Low end of the interval of 95 % of the mean error over any seeds; of forward errors, the "
        "least of a seed. Null if there is one seed."
    )
    error_high: FiniteOrNull = about(
        "Its high end; of forward errors, the largest of a seed. Null if there is one seed, or if "
        "MuJoCo gave up on one."
    )
    error_seeds: int = about("Number of seeds: until the interval is narrow, or the work is done.")
    real_time: float = about("Simulated over CPU time, on one core of this machine.")
    state: PointState = about(
        "Only a point that was written and passed is verified. failed: it was written, and a "
        "measure is worse than that of the model as written."
    )
    verification: str = about(
        "The result of its verification in a phrase; empty without one. A point that is not "
        "verified may have failed as a candidate for the target."
    )
    changed_settings: tuple[ChangedSetting, ...]
    verified: Verification | None = about("Null if it was not written.")
    file: str | None = about("The written model, relative to the report; null if not written.")


class ParameterUncertainty(Model):
    """The error of a parameter that is not known exactly."""

    name: str = about("The parameter and its uncertainty, such as friction 10 %.")
    error: FiniteOrNull = about("Its effect, measured as errors are.")
    body: str = about("The worst body.")


class FarPairs(Model):
    """Collisions of far pairs. That is no proof, so they are removed only on request."""

    distance: float = about(
        "m: no pair came nearer in the task, with gravity tilted, or with twice the inputs."
    )
    geoms: tuple[str, ...] = about("Geoms that stayed farther than that from every other geom.")
    bodies: tuple[tuple[str, str], ...] = about("Bodies that stayed farther apart than that.")
    removed: bool = about("Whether the written models lack these collisions.")
    cost: FiniteOrNull = about(
        "Counted work without them over that of the recommended model, or of the model as written "
        "if none is recommended; null if they are removed already."
    )


class SimplifiedHulls(Model):
    """Convex hulls of meshes with fewer vertices: another shape, within a stated distance."""

    max_distance: float = about("m: no vertex of a hull is farther from the simplified one.")
    meshes: dict[str, int] = about("Largest number of vertices (`maxhullvert`), by mesh.")


class TuneReport(ReportModel):
    """From a model to recommended settings (`tune.json`). Units are SI."""

    tune_version: Literal[8] = 8
    model: str = about("As given.")
    scene_hash: str
    mujoco: str
    task: Task = about("The task that the model is judged on.")
    fall: str = about("If the robot falls in the task: by how much and why; otherwise empty.")
    target: Target
    sentence: str = about("The result in a sentence.")
    target_met: bool = about("Whether the target is met, as written or as recommended.")
    current: Candidate = about("The model as written.")
    current_verdict: CurrentVerdict | None = about("The verdict on the model as written.")
    recommended: Candidate | None = about(
        "The fastest that meets the target and makes no measure worse; null if no change is "
        "recommended."
    )
    front: tuple[FrontPoint, ...] = about(
        "Points from the most accurate to the fastest within the tolerance. The model as written "
        "and the recommended one are points in any case."
    )
    picked: int | None = about("Number of the point that was requested with `--pick`.")
    uncertainty: tuple[ParameterUncertainty, ...] = about(
        "Effects of masses and friction, which are known to a few percent: a numerical error far "
        "below them cannot matter. Empty for forward errors, or without time."
    )
    far_pairs: FarPairs | None = about("Null if there are none, or they were not searched.")
    simplified_hulls: SimplifiedHulls | None = about("Null if no written model has them.")
    closest: Candidate | None = about("If nothing meets the target: the closest candidate.")
    limiting_factor: str = about(
        "Its body, time and row of the error budget, if these were measured; otherwise empty."
    )
    unconstrained_cost: FiniteOrNull = about(
        "If nothing saves 20 %: counted work without contacts and other constraints, at the own "
        "step, over that as written. No solver setting and no pair changes it. Otherwise null."
    )
    equal_error: AlternativeCandidate | None = about(
        "If the model as written is above the tolerance, or above the requested error: the fastest "
        "whose error is no larger; its verdict may be the same. Null if there is none, or if the "
        "recommended candidate takes no longer."
    )
    real_time: float = about("Simulated over CPU time of the model as written, on this machine.")
    integrator: str = about("Integrator of the model as written.")
    reference_integrator: str = about("Integrator of the reference motion.")
    reference_step: float = about("s: step of the reference motion that errors are measured from.")
    candidates: tuple[Candidate, ...] = about("Every measured candidate.")
    changed_settings: tuple[ChangedSetting, ...] = about("Settings that are recommended.")
    masked: tuple[str, ...] = about(
        "Geoms that provably cannot touch anything. Points with `removes_unused` lack their "
        "collisions, and all that follows here up to the flags."
    )
    excluded: tuple[tuple[str, str], ...] = about("Bodies that provably cannot touch each other.")
    removed_sensors: tuple[str, ...]
    disabled_flags: tuple[str, ...] = about("Flags that change no state, and are turned off.")
    not_changed: tuple[SkippedSetting, ...]
    verified: Verification | None = about("Null if nothing is recommended.")
    file: str | None = about("The written model, relative to the report.")
    lines: tuple[PatchedLine, ...] = about("Lines that the patch changes.")
    trials: int = about("Number of configurations that were tried.")
    planned_trials: int = about("Number of configurations that a search without limits tries.")
    ended: SearchEnd = about(
        "complete: nothing was left to try; work: the search did its share of counted work; time: "
        "the time limit ended it early, so that another run may have another result."
    )
    max_cpu: float = about("Limit of CPU time [s], which the share of counted work follows from.")
    seconds: float = about("Wall time of the study.")

    @property
    def problem(self) -> str:
        """The result, if nothing meets the target, or if the picked point failed."""
        for point in self.front:
            if point.number == self.picked and point.state != "verified" and point.verified:
                return f"{self.model}: point {point.number} failed: {point.verification}"
        return "" if self.target_met or self.recommended else f"{self.model}: {self.sentence}"
