"""What is known of a group of runs before they start, and their traces are judged by."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from contactlab.contact.trace_arrays import Floats

SlipMode = Literal["stick", "slide"]
PairMode = Literal["stick", "slide", "apart", "rolls"]
QUARTER_TURN = np.pi / 2
"""What angles are large or small against [rad]."""
PartKind = Literal["free", "ball", "slide", "hinge", "tendon", "actuator"]
_LIMITS = ("iterations", "limits_act", "speculative")
_BY_RUN = ("elliptic", "gravity", "moving_mass", "duration", *_LIMITS)
DEGREES: Mapping[str, int] = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}
"""How many degrees of freedom a joint has."""


@dataclass(frozen=True)
class FreeBody:
    """A body on a free joint.

    Attributes:
        qpos: index of its x coordinate in qpos (then y, z, and the quaternion w x y z).
        dof: index of its x velocity in qvel (then y, z [m/s, world], and rotation [rad/s, body]).
        mass: (n,) mass of its subtree [kg].
    """

    name: str
    qpos: int
    dof: int
    mass: Floats


@dataclass(frozen=True)
class Barrier:
    """A fixed plane or box face that a free body of a monitored pair must not pass.

    Attributes:
        pair: index of the pair in the trace.
        body: the free body.
        point: (3,) a point of the mid-plane of the barrier [m, world].
        normal: (3,) unit normal of the thin direction [world].
        reach: radius [m] about `point`, within the mid-plane, that the barrier surely covers;
            infinite for a plane.
        centre: of the geom that it stops, in the frame of the free body [m].
    """

    pair: int
    body: FreeBody
    point: Floats
    normal: Floats
    reach: float
    centre: Floats = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class HoldWindow:
    """From when to when n runs should hold their scene's subject, each (n,) [s]."""

    start: Floats
    stop: Floats


@dataclass(frozen=True)
class ExpectedContact:
    """What some monitored pairs should do in n runs.

    Attributes:
        pairs: their indices in the trace; the name is what it is said of.
        window: (n, 2) from when to when [s]; NaN in runs that it is not said of.
        timed: whether times are given, between which they should touch all the time.
        mode: `apart`, or what they should do whenever they touch.
        first: what each should do when first in contact.
        last: likewise.
        force: least and greatest sum of their normal forces [N].
        depth: greatest penetration [m].
    """

    name: str
    pairs: tuple[int, ...]
    window: Floats
    timed: bool = False
    mode: PairMode | None = None
    first: SlipMode | None = None
    last: SlipMode | None = None
    force: tuple[float, float] = (-np.inf, np.inf)
    depth: float = np.inf


@dataclass(frozen=True)
class Part:
    """A joint, tendon or actuator: something that goes through a range.

    Attributes:
        name: its name, or what it belongs to.
        place: where it starts: a joint in qpos, a tendon or an actuator among its like.
        low: least position, length or control [m or rad, or as its control is]; -inf without.
        high: the greatest; inf without.
        margin: how far from an end a joint's or a tendon's limit begins to act.
        reach: how far the body of a joint reaches from its frame [m].
    """

    name: str
    kind: PartKind
    place: int
    low: float = -np.inf
    high: float = np.inf
    margin: float = 0.0
    reach: float = 0.0


@dataclass(frozen=True)
class Equality:
    """An equality constraint.

    Attributes:
        name: its name, or its address.
        unit: of its violation, m or rad.
        scale: what its violation is large or small against: the smaller body that it connects, a
            tendon's length, a joint's range or a quarter turn; infinite where none is known.
    """

    name: str
    unit: Literal["m", "rad"]
    scale: float


@dataclass(frozen=True)
class Mechanism:
    """The parts of a model that move and hold.

    Attributes:
        joints: every joint; of a ball joint, `high` is the greatest angle.
        slack: (tendons, 2) lengths between which a tendon's spring is slack; NaN without a spring.
        forces: (actuators, 2) least and greatest force of each; infinite without.
        weight: of the whole model at 9.81 m/s^2 [N].
        size: mean size of a body [m].
    """

    joints: tuple[Part, ...]
    tendons: tuple[Part, ...]
    actuators: tuple[Part, ...]
    slack: Floats
    forces: Floats
    equalities: tuple[Equality, ...]
    weight: float
    size: float = 1.0


@dataclass(frozen=True)
class Setup:
    """What is known of n runs in addition to their trace.

    Attributes:
        settings: every resolved setting and initial value, by name, n values each.
        elliptic: (n,) whether the friction cone is elliptic (else pyramidal).
        iterations: (n,) the solver's iteration limit.
        gravity: (n, 3) gravity [m/s^2, world].
        moving_mass: (n,) mass of all that is not fixed to the world [kg].
        steered: whether a drive keeps changing the controls.
        passive: whether nothing but gravity and contact acts, so that energy cannot grow.
        conservative: whether it is passive, and loses energy in contacts only.
        quaternions: indices in qpos where a unit quaternion starts.
        free_bodies: bodies on free joints.
        barriers: fixed surfaces that free bodies of monitored pairs must not pass.
        thickness: (P,) half the smallest extent [m] of each pair's thinnest geom; inf for planes.
        widths: (P,) width of each pair's solimp, over which its impedance rises [m].
        grounded: (P,) whether one side of each pair is a plane or a height field.
        weights: (P,) weight at 9.81 m/s^2 of the lighter of what each pair presses on [N].
        slots: (P,) contact slots recorded for each pair.
        duration: (n,) requested simulated time [s].
        expected: what monitored pairs should do.
        oracle: name of the scene's closed form, if it has one.
        oracle_tolerance: largest accepted relative or absolute oracle error, as the oracle defines.
        thresholds: label thresholds by name, over the defaults.
        speculative: (n,) whether the engine makes contacts ahead of touch, whose distance is then
            no depth; None where no run does.
        hold: when the subject should be held; None where nothing should.
        limits_act: (n,) whether limits of joints and tendons are on; None where all are.
        mechanism: what of the model can move and hold; None where that is not asked about.
        springs: whether joints or tendons have springs.
    """

    settings: Mapping[str, Sequence[object]]
    elliptic: NDArray[np.bool_]
    iterations: NDArray[np.int32]
    gravity: Floats
    moving_mass: Floats
    steered: bool
    passive: bool
    conservative: bool
    quaternions: tuple[int, ...]
    free_bodies: tuple[FreeBody, ...]
    barriers: tuple[Barrier, ...]
    thickness: Floats
    widths: Floats
    grounded: NDArray[np.bool_]
    weights: Floats
    slots: NDArray[np.int32]
    duration: Floats
    expected: tuple[ExpectedContact, ...] = ()
    oracle: str | None = None
    oracle_tolerance: float = np.inf
    thresholds: Mapping[str, float] = field(default_factory=dict[str, float])
    speculative: NDArray[np.bool_] | None = None
    hold: HoldWindow | None = None
    limits_act: NDArray[np.bool_] | None = None
    mechanism: Mechanism | None = None
    springs: bool = False

    def select(self, runs: Sequence[int]) -> "Setup":
        """Return the setup of the given runs."""
        rows = list(runs)
        bodies = {body.name: replace(body, mass=body.mass[rows]) for body in self.free_bodies}
        arrays = {name: getattr(self, name) for name in _BY_RUN}
        settings = {name: [each[run] for run in rows] for name, each in self.settings.items()}
        return replace(
            self,
            **{name: None if each is None else each[rows] for name, each in arrays.items()},
            settings=settings,
            expected=tuple(replace(each, window=each.window[rows]) for each in self.expected),
            hold=self.hold and HoldWindow(self.hold.start[rows], self.hold.stop[rows]),
            free_bodies=tuple(bodies.values()),
            barriers=tuple(replace(each, body=bodies[each.body.name]) for each in self.barriers),
        )


@dataclass(frozen=True)
class Joints:
    """The joints of a model, by the layout of their part of qpos.

    Attributes:
        scalars: indices in qpos of slides and hinges.
        lengths: (scalars,) factors that turn their differences into metres: 1 for a slide [1],
            for a hinge the reach of what it moves [m].
        points: indices in qpos where the position of a free joint starts.
        rotations: indices in qpos where a unit quaternion starts.
        reaches: (rotations,) factors that turn their angles into metres: the reach of what
            rotates [m].
    """

    scalars: tuple[int, ...]
    lengths: Floats
    points: tuple[int, ...]
    rotations: tuple[int, ...]
    reaches: Floats
