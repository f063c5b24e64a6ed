"""Facts about a group of runs before they start, by which their traces are judged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.required_words import ContactWord, End
from contactlab.contact.trace_arrays import Floats

QUARTER_TURN = np.pi / 2  # what angles are large or small against [rad]
PartKind = Literal["free", "ball", "slide", "hinge", "tendon", "actuator"]
_LIMITS = ("iterations", "limits_act", "speculative")
_BY_RUN = ("elliptic", "gravity", "moving_mass", "duration", *_LIMITS)
DEGREES: Mapping[str, int] = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}
"""How many degrees of freedom a joint has."""


@dataclass(frozen=True)
class FreeBody:
    """A body on a free joint."""

    name: str
    qpos: int  # index of its x coordinate in qpos (then y, z, and the quaternion w x y z)
    dof: int  # index of its x velocity in qvel (then y, z [m/s, world], and rotation [rad/s, body])
    mass: Floats  # (n,) mass of its subtree [kg]
    share: Floats | float = 1.0  # (n,) of its mass that its frame resists with where it is lightest


@dataclass(frozen=True)
class Barrier:
    """A fixed plane or box face that a free body of a monitored pair must not pass."""

    pair: int  # index of the pair in the trace
    body: FreeBody  # the free body
    point: Floats  # (3,) a point of the mid-plane of the barrier [m, world]
    normal: Floats  # (3,) unit normal of the thin direction [world]
    reach: float
    """Radius [m] about `point`, within the mid-plane, that the barrier surely covers; infinite for
    a plane."""
    centre: Floats = field(default_factory=lambda: np.zeros(3))
    """Of the geom that it stops, in the frame of the free body [m]."""


@dataclass(frozen=True)
class HoldWindow:
    """From when to when n runs should hold their scene's subject, each (n,) [s]."""

    start: Floats
    stop: Floats


@dataclass(frozen=True)
class ExpectedContact:
    """Expected behaviour of some monitored pairs in n runs."""

    name: str
    pairs: tuple[int, ...]  # their indices in the trace; the name is what it is said of
    window: Floats  # (n, 2) from when to when [s]; NaN in runs that it is not said of
    word: ContactWord  # what they should do whenever they touch
    end: End | None = None  # the contact that it is said of: each one's first or last
    timed: bool = False  # whether times are given, between which they should touch all the time
    force: tuple[float, float] = (-np.inf, np.inf)
    """Least and greatest sum of their normal forces [N]."""
    depth: float = np.inf  # greatest penetration [m]

    def select(self, rows: list[int]) -> "ExpectedContact":
        """Return what they should do in some of the runs."""
        return replace(self, window=self.window[rows])


@dataclass(frozen=True)
class Part:
    """A joint, tendon or actuator: something that goes through a range."""

    name: str  # its name, or what it belongs to
    kind: PartKind
    place: int  # where it starts: a joint in qpos, a tendon or an actuator among its like
    low: float = -np.inf
    """Least position, length or control [m or rad, or as its control is]; -inf without."""
    high: float = np.inf  # the greatest; inf without
    margin: float = 0.0  # how far from an end a joint's or a tendon's limit begins to act
    reach: float = 0.0  # how far the body of a joint reaches from its frame [m]
    bodies: tuple[str, ...] = ()  # that it moves, or acts on


@dataclass(frozen=True)
class Equality:
    """An equality constraint."""

    name: str  # its name, or its address
    unit: Literal["m", "rad"]  # of its violation, m or rad
    scale: float
    """Length or angle that its violation is compared with: the smaller body that it connects, a
    tendon's length, a joint's range or a quarter turn; infinite where none is known, and where a
    mocap body drives what it is held to."""
    elastic: bool = False  # whether it may stretch by much for a moment, as edges of a flex
    bodies: tuple[str, ...] = ()  # that it connects


@dataclass(frozen=True)
class Mechanism:
    """The parts of a model that move and hold."""

    joints: tuple[Part, ...]  # every joint; of a ball joint, `high` is the greatest angle
    tendons: tuple[Part, ...]
    actuators: tuple[Part, ...]
    slack: Floats
    """(tendons, 2) lengths between which a tendon's spring is slack; NaN without a spring."""
    forces: Floats  # (actuators, 2) least and greatest force of each; infinite without
    equalities: tuple[Equality, ...]


@dataclass(frozen=True)
class RecordedPart:
    """A part of the state that was recorded: a free body's position, a quaternion, or a joint."""

    joint: str
    body: int
    kind: Literal["point", "turn", "slide", "hinge"]
    qpos: slice
    qvel: slice
    # What its error is a share of: the smallest side of the box around a free body, whose turn does
    # not count, or the range of a joint [m or rad].
    size: float


@dataclass(frozen=True)
class RecordedMotion:
    """Recordings of n runs, at M times each; NaN after a run's last row."""

    parts: tuple[RecordedPart, ...]
    times: Floats  # (n, M) since the start of the run [s]
    qpos: Floats  # (n, M, nq)
    qvel: Floats  # (n, M, nv)
    touched: Floats  # (n,) when a free body first touched anything [s]
    impact: NDArray[np.intp]  # (n, 2) its rows before and after that contact; -1 without one
    lost: Floats  # (n,) energy that the model has less of in the latter row [J]; NaN if not known

    def select(self, rows: list[int]) -> "RecordedMotion":
        """Return the motion of some of the runs."""
        return replace(
            self,
            times=self.times[rows],
            qpos=self.qpos[rows],
            qvel=self.qvel[rows],
            touched=self.touched[rows],
            impact=self.impact[rows],
            lost=self.lost[rows],
        )


_AT_ONCE = 0.1  # Time in which what nothing pulls would move by its own size [s]


def pull_of(gravity: Floats, size: float) -> Floats:
    """Return (n,) the magnitude of gravity (n, 3) [m/s^2].

    Without gravity it is what moves a body by a mean `size` [m] in a tenth of a second squared.
    """
    strength = np.linalg.norm(gravity, axis=1)
    return np.where(strength > 0, strength, size / _AT_ONCE**2)


@dataclass(frozen=True)
class Setup:
    """Facts about n runs in addition to their trace."""

    settings: Mapping[str, Sequence[object]]
    """Every resolved setting and initial value, by name, n values each."""
    elliptic: NDArray[np.bool_]  # (n,) whether the friction cone is elliptic (else pyramidal)
    iterations: NDArray[np.int32]  # (n,) the solver's iteration limit
    gravity: Floats  # (n, 3) gravity [m/s^2, world]
    moving_mass: Floats  # (n,) mass of all that is not fixed to the world [kg]
    size: float  # mean size of a body [m]
    exact: float  # to which the engine's collisions are exact [m]
    steered: bool  # whether a drive keeps changing the controls
    passive: bool  # whether nothing but gravity and contact acts, so that energy cannot grow
    conservative: bool  # whether it is passive, and loses energy in contacts only
    quaternions: tuple[int, ...]  # indices in qpos where a unit quaternion starts
    free_bodies: tuple[FreeBody, ...]  # bodies on free joints
    barriers: tuple[Barrier, ...]
    """Fixed surfaces that free bodies of monitored pairs must not pass."""
    thickness: Floats
    """(P,) half the smallest extent [m] of each pair's thinnest geom; inf for planes."""
    reaches: Floats  # (P,) greatest extent of each pair's smallest geom [m]; inf for planes
    widths: Floats  # (P,) width of each pair's solimp, over which its impedance rises [m]
    masses: Floats  # (P,) mass of the lighter of what each pair presses on [kg]
    slots: NDArray[np.int32]  # (P,) contact slots recorded for each pair
    duration: Floats  # (n,) requested simulated time [s]
    expected: tuple[ExpectedContact | ExpectedMotion, ...] = ()
    """What monitored pairs and bodies should do."""
    conveying: bool = False  # whether a surface moves, and what lies on it, while its geom does not
    oracle: str | None = None  # name of the scene's closed form, if it has one
    oracle_tolerance: float = np.inf
    """Largest accepted relative or absolute oracle error, as the oracle defines."""
    thresholds: Mapping[str, float] = field(default_factory=dict[str, float])
    """Label thresholds by name, over the defaults."""
    speculative: NDArray[np.bool_] | None = None
    """(n,) whether the engine makes contacts ahead of touch, whose distance is then no depth; None
    where no run does."""
    hold: HoldWindow | None = None  # when the subject should be held; None where nothing should
    limits_act: NDArray[np.bool_] | None = None
    """(n,) whether limits of joints and tendons are on; None where all are."""
    mechanism: Mechanism | None = None
    """Parts of the model that can move and hold; None where nobody asks about them."""
    springs: bool = False  # whether joints or tendons have springs
    sides: tuple[tuple[str, ...], ...] = ()  # (P,) of each pair the bodies that can move
    recorded: RecordedMotion | None = None  # what the runs are compared with, if that was recorded

    @property
    def pull(self) -> Floats:
        """(n,) acceleration that weights and speeds are measured by [m/s^2]; see `pull_of`."""
        return pull_of(self.gravity, self.size)

    def select(self, runs: Sequence[int]) -> "Setup":
        """Return the setup of the given runs."""
        rows = list(runs)
        if rows == [*range(len(self.duration))]:
            return self
        bodies = {
            body.name: replace(body, mass=body.mass[rows], share=(body.share + 0 * body.mass)[rows])
            for body in self.free_bodies
        }
        arrays = {name: getattr(self, name) for name in _BY_RUN}
        settings = {name: [setting[run] for run in rows] for name, setting in self.settings.items()}
        return replace(
            self,
            **{name: None if array is None else array[rows] for name, array in arrays.items()},
            settings=settings,
            expected=tuple(expectation.select(rows) for expectation in self.expected),
            hold=self.hold and HoldWindow(self.hold.start[rows], self.hold.stop[rows]),
            recorded=self.recorded and self.recorded.select(rows),
            free_bodies=tuple(bodies.values()),
            barriers=tuple(
                replace(barrier, body=bodies[barrier.body.name]) for barrier in self.barriers
            ),
        )


@dataclass(frozen=True)
class Joints:
    """The joints of a model, by the layout of their part of qpos."""

    scalars: tuple[int, ...]  # indices in qpos of slides and hinges
    lengths: Floats
    """(scalars,) factors that turn their differences into metres: 1 for a slide [1], for a hinge
    the reach of what it moves [m]."""
    points: tuple[int, ...]  # indices in qpos where the position of a free joint starts
    rotations: tuple[int, ...]  # indices in qpos where a unit quaternion starts
    reaches: Floats
    """(rotations,) factors that turn their angles into metres: the reach of what rotates [m]."""
