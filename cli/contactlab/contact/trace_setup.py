"""Facts about a group of runs before they start, which measurements of their traces need."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.required_words import ContactWord, End
from contactlab.contact.trace_arrays import Floats

QUARTER_TURN = np.pi / 2  # reference size of angles [rad]
PartKind = Literal["free", "ball", "slide", "hinge", "tendon", "actuator"]
_LIMIT_ARRAYS = ("contact_time", "iterations", "limits_act", "speculative")
_RUN_ARRAYS = ("elliptic", "gravity", "moving_mass", "duration", *_LIMIT_ARRAYS)
DEGREES: Mapping[str, int] = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}
"""Number of degrees of freedom of each kind of joint."""


@dataclass(frozen=True)
class FreeBody:
    """A body on a free joint."""

    name: str
    qpos: int  # index of its x coordinate in qpos (then y, z, and the quaternion w x y z)
    dof: int  # index of its x velocity in qvel (then y, z [m/s, world], and rotation [rad/s, body])
    mass: Floats  # (n,) mass of its subtree [kg]
    share: Floats | float = 1.0  # (n,) smallest share of its mass that resists motion of its frame


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
    """Center of the geom that it stops, in the frame of the free body [m]."""


@dataclass(frozen=True)
class HoldWindow:
    """Start and end of the time of holding the subject in n runs, each (n,) [s]."""

    start: Floats
    stop: Floats


@dataclass(frozen=True)
class ExpectedContact:
    """Required contact of some monitored pairs in n runs."""

    name: str
    pairs: tuple[int, ...]  # their indices in the trace; `name` is the required object
    window: Floats  # (n, 2) start and end [s]; NaN in runs without the requirement
    word: ContactWord  # required behavior whenever they touch
    end: End | None = None  # the contact that it refers to: each pair's first or last
    has_times: bool = False  # whether times are given; between them, the pairs should always touch
    force: tuple[float, float] = (-np.inf, np.inf)
    """Least and greatest sum of their normal forces [N]."""
    depth: float = np.inf  # greatest penetration [m]

    def select(self, rows: list[int]) -> "ExpectedContact":
        """Return the requirement for some of the runs."""
        return replace(self, window=self.window[rows])


@dataclass(frozen=True)
class Part:
    """A joint, tendon or actuator: an element that moves through a range."""

    name: str  # its name, or that of its body
    kind: PartKind
    place: int  # its index: of a joint in qpos, of a tendon or an actuator in its list
    low: float = -np.inf
    """Least position, length or control [m, rad or unit of control]; -inf without a limit."""
    high: float = np.inf  # the greatest; inf without a limit
    margin: float = 0.0  # distance from an end, within it a joint's or a tendon's limit acts
    reach: float = 0.0  # reach of the body of a joint from its frame [m]
    bodies: tuple[str, ...] = ()  # the bodies that it moves, or acts on


@dataclass(frozen=True)
class Equality:
    """An equality constraint."""

    name: str  # its name, or its address
    unit: Literal["m", "rad"]  # unit of its violation, m or rad
    scale: float
    """Length or angle that its violation is compared with: the smaller body that it connects, a
    tendon's length, a joint's range or a quarter turn; infinite if it is unknown, or if a mocap
    body drives the other body."""
    elastic: bool = False  # whether it may stretch strongly for a moment, like edges of a flex
    bodies: tuple[str, ...] = ()  # the bodies that it connects


@dataclass(frozen=True)
class Mechanism:
    """The parts of a model that move and hold."""

    joints: tuple[Part, ...]  # every joint; of a ball joint, `high` is the greatest angle
    tendons: tuple[Part, ...]
    actuators: tuple[Part, ...]
    slack: Floats
    """(tendons, 2) range of lengths with a slack spring; NaN without a spring."""
    forces: Floats  # (actuators, 2) least and greatest force of each; infinite without limits
    equalities: tuple[Equality, ...]


@dataclass(frozen=True)
class RecordedPart:
    """A recorded part of the state: a free body's position, a quaternion, or a joint."""

    joint: str
    body: int
    kind: Literal["point", "turn", "slide", "hinge"]
    qpos: slice
    qvel: slice
    # Reference size of its error: the smallest side of the box around a free body, without its
    # rotation, or the range of a joint [m or rad].
    size: float


@dataclass(frozen=True)
class RecordedMotion:
    """Recordings of n runs, at M times each; NaN after a run's last row."""

    parts: tuple[RecordedPart, ...]
    times: Floats  # (n, M) since the start of the run [s]
    qpos: Floats  # (n, M, nq)
    qvel: Floats  # (n, M, nv)
    touched: Floats  # (n,) time of the first contact of a free body [s]
    impact: NDArray[np.intp]  # (n, 2) rows before and after that contact; -1 without one
    lost: Floats  # (n,) decrease of the model's energy between these rows [J]; NaN if unknown

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


def pull_of(gravity: Floats, size: float) -> Floats:
    """Return (n,) the magnitude of gravity (n, 3) [m/s^2].

    Without gravity it is the acceleration by a mean body `size` [m] per tenth of a second squared.
    """
    strength = np.linalg.norm(gravity, axis=1)
    # Time scale of a body's motion by its own size without gravity [s].
    return np.where(strength > 0, strength, size / 0.1**2)


@dataclass(frozen=True)
class Setup:
    """Facts about n runs in addition to their trace."""

    settings: Mapping[str, Sequence[object]]
    """Every resolved setting and initial value, by name, n values each."""
    elliptic: NDArray[np.bool_]  # (n,) whether the friction cone is elliptic, not pyramidal
    iterations: NDArray[np.int32]  # (n,) the solver's iteration limit
    gravity: Floats  # (n, 3) gravity [m/s^2, world]
    moving_mass: Floats  # (n,) mass of all bodies that are not fixed to the world [kg]
    size: float  # mean size of a body [m]
    exact: float  # accuracy of the engine's collisions [m]
    steered: bool  # whether a drive keeps changing the controls
    passive: bool  # whether only gravity and contact act, so that energy cannot grow
    conservative: bool  # whether it is passive, and loses energy in contacts only
    quaternions: tuple[int, ...]  # start indices of unit quaternions in qpos
    free_bodies: tuple[FreeBody, ...]  # bodies on free joints
    barriers: tuple[Barrier, ...]
    """Fixed surfaces that free bodies of monitored pairs must not pass."""
    thickness: Floats
    """(P,) half the smallest extent [m] of each pair's thinnest geom; inf for planes."""
    reaches: Floats  # (P,) greatest extent of each pair's smallest geom [m]; inf for planes
    widths: Floats  # (P,) width of each pair's solimp; its impedance rises over it [m]
    masses: Floats  # (P,) mass of the lighter side of each pair [kg]
    slots: NDArray[np.int32]  # (P,) contact slots recorded for each pair
    duration: Floats  # (n,) requested simulated time [s]
    expected: tuple[ExpectedContact | ExpectedMotion, ...] = ()
    """Requirements of monitored pairs and bodies."""
    undriven: float = 0.0  # time until something first drives a model that is not passive [s]
    yielding: bool = False  # whether springs yield, and so take energy for good
    conveying: bool = False  # whether a surface moves, like a belt's, while its geom does not
    oracle: str | None = None  # name of the scene's closed form, if it has one
    oracle_tolerance: float = np.inf
    """Largest accepted relative or absolute oracle error, as the oracle defines."""
    thresholds: Mapping[str, float] = field(default_factory=dict[str, float])
    """Label thresholds by name, over the defaults."""
    speculative: NDArray[np.bool_] | None = None
    """(n,) whether the engine makes contacts ahead of touch, with distances that are not depths;
    None if no run does."""
    hold: HoldWindow | None = None  # time of holding the subject; None without a hold
    contact_time: Floats | None = None
    """(n,) the longest 1 / sqrt(K) [s] of any contact: sooner, it has not reached its depth."""
    limits_act: NDArray[np.bool_] | None = None
    """(n,) whether limits of joints and tendons are on; None if all are."""
    mechanism: Mechanism | None = None
    """Parts of the model that can move and hold; None if they are not needed."""
    springs: bool = False  # whether joints or tendons have springs
    sides: tuple[tuple[str, ...], ...] = ()  # (P,) the movable bodies of each pair
    recorded: RecordedMotion | None = None  # recorded motion to compare the runs with, if any

    @property
    def pull(self) -> Floats:
        """(n,) acceleration that scales weights and speeds [m/s^2]; see `pull_of`."""
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
        arrays = {name: getattr(self, name) for name in _RUN_ARRAYS}
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
    """(scalars,) factors that convert their differences to meters: 1 for a slide [1], for a hinge
    the reach of the moved bodies [m]."""
    points: tuple[int, ...]  # start indices of positions of free joints in qpos
    rotations: tuple[int, ...]  # start indices of unit quaternions in qpos
    reaches: Floats
    """(rotations,) factors that convert their angles to meters: the reach of the rotated bodies
    [m]."""
