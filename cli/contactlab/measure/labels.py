"""The table of labels, worst first."""

from collections.abc import Mapping
from types import MappingProxyType

from contactlab.measure.friction_rules import (
    chatter,
    oracle_miss,
    unexpected_slide,
    unexpected_stick,
)
from contactlab.measure.integrity import diverged, invalid, solver_nonconvergence
from contactlab.measure.label import Label
from contactlab.measure.symptoms import (
    deep_penetration,
    energy_injection,
    penetration_growth,
    tunneling,
)

STABLE = Label("stable", "No other label applies.", (), None)

LABELS: Mapping[str, Label] = MappingProxyType(
    {
        label.name: label
        for label in (
            Label("crashed", "The process that simulated it died.", (), None),
            Label("timeout", "It took longer than it was given.", (), None),
            Label(
                "invalid",
                "It asks for what cannot be simulated, or recorded no step.",
                (),
                invalid,
            ),
            Label(
                "diverged",
                "The engine lost it: a warning, a number that is not finite, a clock that does "
                "not tick by one timestep a step, a quaternion off unit norm, or fewer steps than "
                "asked for.",
                ("clock_error", "quaternion_error"),
                diverged,
            ),
            Label(
                "solver_nonconvergence",
                "The constraint solver used all its iterations in most steps with contact.",
                ("saturated_share",),
                solver_nonconvergence,
            ),
            Label(
                "tunneling",
                "A body passed the mid-plane of a surface that should stop it, or two bodies "
                "went deeper into each other than the middle of the thinner.",
                (),
                tunneling,
            ),
            Label(
                "energy_injection",
                "A passive scene gained energy, or threw out a body faster than its energy allows.",
                ("energy_gain", "speed_ratio"),
                energy_injection,
            ),
            Label(
                "penetration_growth",
                "A resting pair keeps sinking into each other.",
                ("penetration_growth",),
                penetration_growth,
            ),
            Label(
                "deep_penetration",
                "A pair rests too deep in each other.",
                ("penetration_steady",),
                deep_penetration,
            ),
            Label(
                "chatter",
                "A pair keeps switching between stick and slide.",
                ("mode_switches", "mode_switch_count"),
                chatter,
            ),
            Label(
                "unexpected_slide",
                "A pair slides first or last, where the scene says that it sticks.",
                ("mode_hold",),
                unexpected_slide,
            ),
            Label(
                "unexpected_stick",
                "A pair sticks first or last, where the scene says that it slides.",
                ("mode_hold",),
                unexpected_stick,
            ),
            Label(
                "oracle_miss",
                "It is farther from the scene's closed form than the scene accepts.",
                (),
                oracle_miss,
            ),
            STABLE,
        )
    }
)
