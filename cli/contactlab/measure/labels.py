"""The table of labels, worst first."""

from collections.abc import Mapping
from types import MappingProxyType

from contactlab.measure.checks import missed_contact, phantom_contact, solver_inconsistent
from contactlab.measure.friction_rules import (
    chatter,
    oracle_miss,
    unexpected_slide,
    unexpected_stick,
)
from contactlab.measure.hold_rules import broken, exploited, slipping
from contactlab.measure.integrity import (
    contacts_cut,
    diverged,
    invalid,
    solver_nonconvergence,
)
from contactlab.measure.label import Label
from contactlab.measure.rest_rules import creep, drift, unsettled
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
                "solver_inconsistent",
                "The engine contradicts itself: the solver stopped content with a wrong answer, a "
                "sparse Jacobian changes the answer, or the same run gives another trajectory.",
                ("residual", "jacobian_difference"),
                solver_inconsistent,
            ),
            Label(
                "solver_nonconvergence",
                "The constraint solver used all its iterations, in most steps with contact or, "
                "where a second pass looked, without being done.",
                ("saturated_share", "residual"),
                solver_nonconvergence,
            ),
            Label(
                "broken",
                "What is held is so deep in its holder that the contact means nothing.",
                ("broken",),
                broken,
            ),
            Label(
                "tunneling",
                "A body passed the mid-plane of a surface that should stop it, or two bodies "
                "went deeper into each other than the middle of the thinner.",
                ("pierced",),
                tunneling,
            ),
            Label(
                "missed_contact",
                "A graded pair overlaps and has no contact.",
                ("missed_contact",),
                missed_contact,
            ),
            Label(
                "phantom_contact",
                "A contact says that bodies touch which are apart.",
                ("phantom_contact",),
                phantom_contact,
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
                "exploited",
                "What is held is held by sinking in, as no solid body could be.",
                ("exploited",),
                exploited,
            ),
            Label(
                "deep_penetration",
                "A pair rests too deep in each other.",
                ("penetration_steady",),
                deep_penetration,
            ),
            Label(
                "drift",
                "A body that should stay ended farther from its start than the scene accepts.",
                ("drift",),
                drift,
            ),
            Label(
                "chatter",
                "A pair keeps switching between stick and slide, or keeps losing its contact "
                "while it sticks, and not only while it comes to rest; in the hold window, if the "
                "scene has one.",
                ("mode_switches", "contact_losses", "mode_switch_count"),
                chatter,
            ),
            Label(
                "slipping",
                "What should be held slips, is no longer in its place, or bears no force.",
                ("hold_slip", "hold_offset", "hold_contact"),
                slipping,
            ),
            Label(
                "unsettled",
                "A body still moves in the last fifth, where the scene says that all rest.",
                ("rest_speed",),
                unsettled,
            ),
            Label(
                "creep",
                "A pair that sticks slips faster than the scene accepts.",
                ("creep_speed",),
                creep,
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
            Label(
                "contacts_cut",
                "A graded pair had more contacts than slots: net forces, modes and whatever is "
                "measured of them are those of the recorded contacts alone.",
                (),
                contacts_cut,
            ),
            STABLE,
        )
    }
)
