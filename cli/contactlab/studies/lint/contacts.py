"""Rules of contact parameters: effects of the timestep, the cone and the engine."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.contact.contact_laws import (
    STABLE_STEP,
    damping_ratio,
    refsafe_solref,
    stiffness_damping,
)
from contactlab.judge.limits import MILLIMETRES, MILLISECONDS, Limit
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.contact_pairs import touch_pairs, touch_places
from contactlab.scene.model_text import mjcf_text
from contactlab.studies.lint.linted_model import Edit, Fault, LintedModel
from contactlab.studies.lint.rules import rule

Solref = tuple[float, ...]
_DEFAULT: Solref = (0.02, 1.0)
_LESS = 1 - SUM_ROUNDING  # of the timestep, for rounding
_DISABLE = mujoco.mjtDisableBit
_REFSAFE = int(_DISABLE.mjDSBL_REFSAFE)
_NO_CONTACT = int(_DISABLE.mjDSBL_CONTACT) | int(_DISABLE.mjDSBL_CONSTRAINT)

SHELL = Limit(
    "shell",
    "m",
    "warn",
    1e-4,
    printed_unit=MILLIMETRES,
    exceeded="margin lets contact force start {} before touch",
)
"""A margin may be as large as the accepted penetration."""
SOFTNESS = Limit("softness", "s", "warn", 0.02, printed_unit=MILLISECONDS)
"""1 / sqrt(K) of the engine's default solref."""


def softness_seconds(solref: Solref) -> float:
    """Return 1 / sqrt(K) [s] of a solref; infinite without stiffness."""
    stiffness = float(stiffness_damping(solref)[0])
    return stiffness**-0.5 if stiffness > 0 else np.inf


class _User(NamedTuple):
    """A part of the model with a solref."""

    kind: str
    number: int
    attribute: str
    solref: Solref


def _touching_geoms(model: mujoco.MjModel) -> np.ndarray:
    """Return the geoms that can touch others by their masks; pairs have their own parameters."""
    if model.opt.disableflags & _NO_CONTACT:
        return np.empty(0, int)
    return np.unique(touch_places(model, listed=False))


def _solref_users(model: mujoco.MjModel) -> Iterator[_User]:
    """Yield the parts with a solref that takes effect."""
    overridden = int(model.opt.enableflags) & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
    kinds: list[tuple[str, str, np.ndarray, Callable[[int], object]]] = [
        ("equality", "solref", model.eq_solref, lambda index: model.eq_active0[index]),
        ("joint", "solreflimit", model.jnt_solref, lambda index: model.jnt_limited[index]),
        ("tendon", "solreflimit", model.tendon_solref_lim, lambda i: model.tendon_limited[i]),
    ]
    if not overridden:
        solid = set(_touching_geoms(model).tolist())
        kinds.append(("geom", "solref", model.geom_solref, solid.__contains__))
        kinds.append(("pair", "solref", model.pair_solref, lambda _: True))
    for kind, attribute, rows, acts in kinds:
        for index, row in enumerate(rows.tolist()):
            if acts(index):
                yield _User(kind, index, attribute, (row[0], row[1]))


def _users_by_solref(
    linted: LintedModel, wrong: Callable[[Solref], bool]
) -> Iterator[tuple[Solref, list[_User]]]:
    """Yield each wrong solref, with the parts of one kind that have it."""
    users_by_solref: dict[tuple[str, Solref], list[_User]] = defaultdict(list)
    is_wrong = cache(wrong)  # many parts have the same
    for user in _solref_users(linted.model):
        if is_wrong(user.solref):
            users_by_solref[user.kind, user.solref].append(user)
    for (_, solref), users in users_by_solref.items():
        yield solref, users


def _set_solref(linted: LintedModel, users: list[_User], solref: Solref) -> tuple[Edit, ...]:
    edits: dict[Edit, None] = {}
    for user in users:
        changes = linted.set(user.kind, user.number, **{user.attribute: mjcf_text(solref)})
        edits |= dict.fromkeys(changes)
    return tuple(edits)


def _users_text(linted: LintedModel, users: list[_User]) -> str:
    first = f"{users[0].kind} '{linted.name(users[0].kind, users[0].number)}'"
    return first if len(users) == 1 else f"{first} and {len(users) - 1} more"


@rule("solref-step", "warn")
def find_raised_time_constants(linted: LintedModel) -> Iterator[Fault]:
    """A time constant of solref is below two timesteps, so another one acts.

    `refsafe` raises it silently, so the constraint is softer. Fix: the solref that acts, which is
    the same motion, or a shorter timestep.
    """
    model = linted.model
    step, safe = float(model.opt.timestep), not model.opt.disableflags & _REFSAFE

    def short(solref: Solref) -> bool:
        return solref != _DEFAULT and min(solref) > 0 and solref[0] < 2 * step * _LESS

    for solref, users in _users_by_solref(linted, short):
        acts = refsafe_solref(solref, step)
        end = (
            f"it acts as {mjcf_text(acts)}: softer than it is written"
            if safe
            else "and refsafe, which would raise it, is off"
        )
        yield Fault(
            f"{users[0].attribute} {mjcf_text(solref)} of {_users_text(linted, users)} is below "
            f"two timesteps ({2e3 * step:g} ms): {end}",
            linted.place(users[0].kind, users[0].number),
            _set_solref(linted, users, acts),
        )


@rule("long-step", "note")
def find_long_steps(linted: LintedModel) -> Iterator[Fault]:
    """The timestep is too long for MuJoCo's default solref, which acts softer then.

    It is more than half of `0.02`. Fix: a timestep of at most 10 ms.
    """
    step = float(linted.model.opt.timestep)
    users = [user for user in _solref_users(linted.model) if user.solref == _DEFAULT]
    if users and 2 * step * _LESS > _DEFAULT[0]:
        yield Fault(
            f"a timestep of {1e3 * step:g} ms is more than half the time constant of the default "
            f"solref, {mjcf_text(_DEFAULT)}, of {_users_text(linted, users)}",
            linted.place_of("option"),
            linted.set_in("option", timestep=mjcf_text(_DEFAULT[0] / 2)),
        )


@rule("solref-energy", "warn")
def find_stiff_solrefs(linted: LintedModel) -> Iterator[Fault]:
    """A contact is too stiff for its damping at this timestep: an impact can gain energy.

    The timestep is above 0.8 / sqrt(K) of a contact that is less than critically damped. `refsafe`
    does not prevent it. Fix: the longest timestep that holds it, or more damping.
    """
    model = linted.model
    step, safe = float(model.opt.timestep), not model.opt.disableflags & _REFSAFE
    if model.opt.integrator == getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", -1):
        return

    def gains(solref: Solref) -> bool:
        acts = refsafe_solref(solref, step) if safe else solref
        return step / softness_seconds(acts) > STABLE_STEP and float(damping_ratio(acts)) < 1

    for solref, users in _users_by_solref(linted, gains):
        if users[0].kind in ("geom", "pair"):
            acts = refsafe_solref(solref, step) if safe else solref
            holds = STABLE_STEP * softness_seconds(acts)
            yield Fault(
                f"solref {mjcf_text(solref)} of {_users_text(linted, users)} has 1 / sqrt(K) of "
                f"{1e3 * softness_seconds(acts):.3g} ms: impacts can gain energy at steps "
                f"above {1e3 * holds:.3g} ms",
                linted.place(users[0].kind, users[0].number),
                linted.set_in("option", timestep=f"{float(f'{0.98 * holds:.1e}'):g}"),
            )


@rule("solref-mixed", "gate")
def find_mixed_solrefs(linted: LintedModel) -> Iterator[Fault]:
    """A solref has one negative number and one positive: the engine takes the default instead.

    Fix: the default, which acts anyway.
    """
    for solref, users in _users_by_solref(linted, lambda solref: solref[0] * solref[1] < 0):
        attribute = users[0].attribute
        yield Fault(
            f"{attribute} {mjcf_text(solref)} of {_users_text(linted, users)} is of neither form: "
            "write both above 0, or -stiffness and -damping",
            linted.place(users[0].kind, users[0].number),
            _set_solref(linted, users, _DEFAULT),
        )


@rule("frictionless-condim", "warn")
def find_frictionless_condims(linted: LintedModel) -> Iterator[Fault]:
    """Two geoms make contacts with friction of coefficient zero; condim 1 means no friction.

    MuJoCo raises the friction to 1e-5, a cone of almost no width, which costs rows and scales
    badly. Fix: `condim="1"`, the same contact.
    """
    model = linted.model
    least = mujoco.mjMINMU
    slides = model.geom_friction[:, 0] <= least
    listed = np.flatnonzero((model.pair_dim > 1) & (model.pair_friction[:, 0] <= least)).tolist()
    for pair in listed:
        name = linted.name("pair", pair)
        yield _friction_fault(linted, f"pair '{name}'", int(model.pair_dim[pair]), "pair", pair)
    if not slides.any() or model.opt.disableflags & _NO_CONTACT:
        return
    reported_geoms = set[int]()
    for first, second in touch_pairs(model, listed=False):
        priority = model.geom_priority[[first, second]]
        deciding = [g for g in (first, second) if model.geom_priority[g] == priority.max()]
        condim = int(model.geom_condim[deciding].max())
        if condim > 1 and slides[deciding].all() and not reported_geoms & set(deciding):
            reported_geoms |= set(deciding)
            geom = deciding[int(np.argmax(model.geom_condim[deciding]))]
            names = [linted.name("geom", g) for g in (first, second)]
            yield _friction_fault(linted, f"{names[0]} - {names[1]}", condim, "geom", geom)


def _friction_fault(linted: LintedModel, who: str, condim: int, kind: str, index: int) -> Fault:
    elliptic = linted.model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    cone = (
        "a cone of no width, which the solver scales badly by" if elliptic else "rows for nothing"
    )
    return Fault(
        f"{who} has condim {condim} and no sliding friction: {cone}; condim 1 is the same contact",
        linted.place(kind, index),
        linted.set(kind, index, condim="1"),
    )


@rule("contact-margin", "note")
def find_large_margins(linted: LintedModel) -> Iterator[Fault]:
    """Contacts push before geoms touch.

    The margins of two geoms add to more than 0.1 mm. Fix: `margin="0"`; `gap` finds contacts early
    without force.
    """
    model = linted.model
    solid = _touching_geoms(model)
    wide = [geom for geom in solid.tolist() if 2 * model.geom_margin[geom] > (SHELL.value or 0)]
    if wide:
        largest = max(wide, key=lambda geom: model.geom_margin[geom])
        edits: dict[Edit, None] = {}
        for geom in wide:
            edits |= dict.fromkeys(linted.set("geom", geom, margin="0"))
        yield Fault(
            f"geom '{linted.name('geom', largest)}' has a margin of "
            f"{1e3 * model.geom_margin[largest]:g} mm, and {len(wide) - 1} more have one: two such "
            "push from the sum on, before they touch",
            linted.place("geom", largest),
            tuple(edits),
        )


@rule("contact-softness", "note")
def find_soft_contacts(linted: LintedModel) -> Iterator[Fault]:
    """Contacts are softer than the engine's default.

    The default lets a body sink by a tenth of a millimetre. Fix: the default.
    """
    limit = SOFTNESS.value or 0.0
    for solref, users in _users_by_solref(
        linted, lambda solref: softness_seconds(solref) > limit * (1 + SUM_ROUNDING)
    ):
        if users[0].kind in ("geom", "pair"):
            yield Fault(
                f"solref {mjcf_text(solref)} of {_users_text(linted, users)} is softer than "
                f"MuJoCo's default: 1 / sqrt(K) is {1e3 * softness_seconds(solref):.3g} ms, not "
                f"{1e3 * limit:g}",
                linted.place(users[0].kind, users[0].number),
                _set_solref(linted, users, _DEFAULT),
            )
