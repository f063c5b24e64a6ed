"""Where labels begin, unless a scene or a sweep says otherwise."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from contactlab.errors import SceneError, did_you_mean


@dataclass(frozen=True)
class Threshold:
    """One limit of a label.

    Attributes:
        name: its name in scenes and sweeps.
        default: its value where neither says one; None if it limits nothing then.
        unit: its unit; `1` for counts and ratios.
        source: what it limits, and where the default is from.
    """

    name: str
    default: float | None
    unit: str
    source: str


THRESHOLDS: Mapping[str, Threshold] = MappingProxyType(
    {
        each.name: each
        for each in (
            Threshold(
                "clock_error",
                1e-9,
                "1",
                "Largest deviation of a step of simulated time from the timestep, as a share of "
                "it. Rounding stays a thousand times below; an engine that resets does not.",
            ),
            Threshold(
                "quaternion_error",
                1e-3,
                "1",
                "Largest deviation of a quaternion's norm from 1. The engine normalises at every "
                "step, so that healthy runs stay near 1e-16.",
            ),
            Threshold(
                "saturated_share",
                0.5,
                "1",
                "Share of the steps with contact in which the solver used all its iterations, if "
                "it may use two or more. Newton warm-started takes 0 or 1 iterations in most "
                "steps, and never more than 7 on hard stacks; PGS on a stack with a weight on it "
                "used all of 20 in every step and left residuals of 1e2.",
            ),
            Threshold(
                "energy_gain",
                0.01,
                "1",
                "Largest metric energy_gain. Measured: good settings stay below 1.01 of the "
                "energy at the start, bad ones reach 3 to 1500.",
            ),
            Threshold(
                "speed_ratio",
                1.05,
                "1",
                "Largest metric speed_ratio; 5 % of speed is 10 % of energy.",
            ),
            Threshold(
                "penetration_growth",
                1e-4,
                "m",
                "Largest depth that a resting pair gains at its rate of sinking in half the run: "
                "0.1 mm, the depth that practice accepts on flat ground.",
            ),
            Threshold(
                "penetration_steady",
                5e-3,
                "m",
                "Largest metric penetration_steady. Practice asks for 0.1 mm on flat ground, which "
                "the engine's default contact meets under light loads only, and calls grasps over "
                "5 mm broken. Unless set, half the thickness that the pair holds in `Setup` "
                "applies where that is less.",
            ),
            Threshold(
                "pierced",
                None,
                "m",
                "Largest metric penetration_max, where no fixed surface is known that must not be "
                "passed. Unless set, half the thickness that the pair holds in `Setup` applies: "
                "of bodies of many geoms, that of the thinnest, however it is met.",
            ),
            Threshold(
                "mode_switches",
                5,
                "1/s",
                "Largest metric mode_switches; practice calls a pad with more chattering.",
            ),
            Threshold(
                "mode_switch_count",
                3,
                "1",
                "Fewest switches that chatter has: one stop and one start are none.",
            ),
            Threshold(
                "contact_losses",
                5,
                "1/s",
                "Largest metric contact_losses, as for mode_switches: contacts that hold keep "
                "their contact, and a pad that bounces on what it holds loses it 70 times.",
            ),
            Threshold(
                "exploited",
                3e-3,
                "m",
                "Largest metric hold_penetration of a grasp that holds by its contact; practice "
                "calls one over 3 mm exploited.",
            ),
            Threshold(
                "broken",
                5e-3,
                "m",
                "Largest metric hold_penetration of a grasp that means anything; practice calls "
                "one over 5 mm broken.",
            ),
            Threshold(
                "hold_slip",
                2e-3,
                "m",
                "Largest metric hold_slip. Soft contact creeps by less, 0.01 to 1 mm in half a "
                "second; what slides or chatters loses 8 mm and more.",
            ),
            Threshold(
                "hold_offset",
                None,
                "m",
                "Largest metric hold_offset; only scenes that begin with the subject in its place "
                "between the fingers set it.",
            ),
            Threshold(
                "hold_contact",
                0.5,
                "1",
                "Least metric hold_contact. Sliding bodies hop, and touch in half of the steps.",
            ),
            Threshold(
                "creep_speed",
                None,
                "m/s",
                "Largest metric creep_speed; only scenes in which what sticks should stay set it.",
            ),
            Threshold(
                "drift",
                None,
                "m",
                "Largest metric drift; only scenes whose bodies should stay set it.",
            ),
            Threshold(
                "rest_speed",
                None,
                "m/s",
                "Largest metric rest_speed; only scenes whose bodies should come to rest set it.",
            ),
            Threshold(
                "residual",
                1e-2,
                "1",
                "Largest metric solver_residual. Healthy: Newton up to 2e-5, CG 2e-4, PGS 5e-4; "
                "PGS with 5 iterations on a stack 15, a wrong Hessian 4 and more.",
            ),
            Threshold(
                "jacobian_difference",
                1e-6,
                "1",
                "Largest metric jacobian_difference; the two are the same mathematics, and agree "
                "to 1e-7 where both converge.",
            ),
            Threshold(
                "missed_contact",
                1e-4,
                "m",
                "Largest metric overlap_missed; collision tolerances are a hundred times finer.",
            ),
            Threshold(
                "phantom_contact",
                1e-4,
                "m",
                "Largest metric distance_phantom, likewise.",
            ),
            Threshold(
                "mode_hold",
                0.02,
                "s",
                "Shortest time that a mode lasts to count as the first or the last of a pair. "
                "Measured: sliding is told from sticking to within 4 to 24 ms.",
            ),
        )
    }
)


def limits(overrides: Mapping[str, float]) -> dict[str, float]:
    """Return the value of every threshold that has one, the overrides over the defaults.

    Raises:
        SceneError: a name is not that of a threshold.
    """
    for name in overrides:
        if name not in THRESHOLDS:
            hint = did_you_mean(name, THRESHOLDS)
            raise SceneError(f"no threshold '{name}'{hint}; there are {', '.join(THRESHOLDS)}")
    usual = {each.name: each.default for each in THRESHOLDS.values() if each.default is not None}
    return {**usual, **overrides}
