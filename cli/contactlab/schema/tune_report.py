"""The report of `contactlab tune`, and of `contactlab tradeoff MODEL`: what was tried and found."""

from typing import Literal

from contactlab.schema.error_budget import BudgetPrice
from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task

TUNE_VERSION = 2
REPORT, MODEL, FOLDER = "tune.json", "tuned.xml", "tuned"
PATCH = f"{FOLDER}/tuned.patch"
"""Files of the study's folder; the model lies in `tuned`, with what it refers to."""
FOLDER_OF_AIM = "to_aim"
"""Folder of a model that keeps an aim which the model as written misses, at a higher price."""
FOLDER_AS_NOW = "as_now"
"""Folder of a model that is as accurate as the model as written, where that is not sound."""

AimKind = Literal["uncertainty", "error", "real time", "watched"]


class Aim(Model):
    """What is searched for."""

    kind: AimKind = about(
        "uncertainty: the cheapest whose error is at most what the model is uncertain by; error: "
        "at most what is asked for; real time: the most accurate that is fast enough; watched: the "
        "cheapest whose forward error is at most what is asked for."
    )
    limit: float = about("Largest error: a share of the real forces, or in the unit.")
    unit: str = about("Of errors: 1, a share; m; or that of a sensor.")
    within: float = about("The tolerance, a share.")
    uncertain: float | None = about(
        "What friction +-10 % or masses +-5 % are worth at most; null if not measured."
    )
    uncertain_by: str = about("Which of them, in which body and phase; empty if not measured.")
    real_time: float | None = about("Simulated over CPU time that is asked for.")
    watched: tuple[str, ...] = about("Bodies, sites and sensors of a forward error.")
    at: Literal["end", "peak"] | None = about("When the forward error is looked at.")
    growth: str = about("What became of nudged copies; empty where no forward error is asked for.")


class Point(Model):
    """A choice of settings that was tried."""

    settings: dict[str, Setting] = about("What differs from the model as written.")
    timestep: float = about("s")
    lighter: bool = about("Without what changes no state: see the report.")
    apart: bool = about("Without collisions of what stayed apart: see the report.")
    hulls: bool = about("With fewer vertices of hulls: see the report.")
    error: float | None = about("Of its worst body, the mean over seeds; null if it gave up.")
    low: float | None = about("Least over seeds.")
    high: float | None = about("Largest over seeds.")
    body: str = about("The worst.")
    phase: str
    time: float | None = about("When its worst window begins [s since the phase began].")
    price: BudgetPrice | None = about("Time over that of the model as written; null if not timed.")


class Verified(Model):
    """What is recommended, as its files have it, on seeds that nobody had seen."""

    seeds: tuple[int, ...]
    holds: bool
    keeps_aim: bool = about("Whether it keeps the aim, too, where what is recommended need not.")
    error: float | None = about("As in the search; null if it gave up.")
    now: float | None = about("That of the model as written.")
    word: str = about("The verdict of `contactlab MODEL` on its numerics.")
    share: float | None = about("Its own backward error, as `contactlab MODEL` has it.")
    labels: tuple[str, ...] = about("Of its runs, which those of the model as written have not.")
    sentence: str = about("Why it does not hold, or that it does.")


class Judged(Model):
    """What `contactlab MODEL` says of the numerics of the model as written."""

    seeds: tuple[int, ...] = about("Of the task: all, or as many as time was left for.")
    word: str
    share: float | None = about(
        "Its own backward error, in windows that begin where the model itself is: an error of the "
        "search is measured where its finer motion is."
    )


class Changed(Model):
    """A setting that is recommended, and what it was."""

    name: str
    before: Setting
    after: Setting


class Kept(Model):
    """Setting that was not tried, and why."""

    name: str
    reason: str


class Line(Model):
    """A line of a file of the model, as the patch makes it; empty if it goes."""

    file: str
    line: int
    element: str


class OtherAnswer(Model):
    """Another answer beside what is recommended, written and verified like it."""

    point: Point
    changes: tuple[Changed, ...]
    verified: Verified
    file: str = about("The written model, relative to the report.")


class StayedApart(Model):
    """Collisions of what stayed apart in all that was run: no proof, so only left out if asked."""

    margin: float = about(
        "m: no pair came nearer in the task, with gravity tilted, or with twice the inputs."
    )
    geoms: tuple[str, ...] = about("That came so near to nothing.")
    bodies: tuple[tuple[str, str], ...] = about("That came so near to each other never.")
    left_out: bool = about("Whether the written models lack them.")
    price: BudgetPrice | None = about(
        "Time without them, over that of what is recommended, or keeps the aim, or is as written; "
        "null where they are left out already."
    )


class FewerVertices(Model):
    """Convex hulls of meshes with fewer vertices: another shape, by a distance that is stated."""

    within: float = about("m: no vertex of a hull is farther from the smaller one.")
    meshes: dict[str, int] = about("Most vertices (`maxhullvert`), by mesh.")


class TuneReport(Model):
    """From a model to the settings to use (`tune.json`). Units are SI."""

    tune_version: Literal[2] = TUNE_VERSION
    model: str = about("As given.")
    scene_hash: str
    mujoco: str
    task: Task = about("What it is judged on.")
    aim: Aim
    sentence: str = about("The answer.")
    met: bool = about("Whether the aim is met: as written, as recommended, or by `to_aim`.")
    now: Point
    judged: Judged | None = about("The model as written; null if no time was left to ask.")
    recommended: Point | None = about(
        "The fastest within the aim, and sound; where a sound model misses the default aim as "
        "written, the fastest whose error is no larger than now; where it is not sound, the "
        "fastest within the tolerance. Null if the model is kept, or nothing does."
    )
    to_aim: OtherAnswer | None = about("Where that misses the aim: the fastest that keeps it.")
    stayed_apart: StayedApart | None = about("Null if nothing did, or it was not looked at.")
    fewer_vertices: FewerVertices | None = about("Null if no written model has them.")
    nearest: Point | None = about("If nothing meets the aim: what comes nearest.")
    binds: str = about("Then what binds: body, time and row, if that was looked at; else empty.")
    bare: BudgetPrice | None = about(
        "Where nothing saves a fifth: time of the model without contacts and other constraints, at "
        "its own step, over that as written: what no solver and no pair costs. Null without."
    )
    as_accurate: OtherAnswer | None = about(
        "Where the model as written is beyond the tolerance, or what was asked for: the fastest "
        "that is no less accurate, and need be no sounder; null without, or if what is recommended "
        "costs no more."
    )
    real_time: float = about("Simulated over CPU time of the model as written, on this machine.")
    fine_step: float = about("s: of the motion that errors are distances from.")
    points: tuple[Point, ...] = about("All that was tried.")
    changes: tuple[Changed, ...] = about("What is recommended.")
    masked: tuple[str, ...] = about("Geoms that can touch nothing, by proof.")
    excluded: tuple[tuple[str, str], ...] = about("Bodies that cannot touch, by proof.")
    sensors: tuple[str, ...] = about("Sensors that were left out.")
    flags: tuple[str, ...] = about("Flags that compute what changes no state, and were left out.")
    kept: tuple[Kept, ...]
    verified: Verified | None = about("Null if nothing is recommended.")
    file: str | None = about("The written model, relative to the report.")
    lines: tuple[Line, ...] = about("What the patch changes.")
    ended: bool = about("Whether the time was over before nothing was left to try.")
    seconds: float = about("Wall time that it took.")
