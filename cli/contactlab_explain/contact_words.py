"""Contact settings in units of the world, and back: laws of rest and impact, shown by a run.

At rest, depth r of a contact carries F with ``r = s F A (1 - d) dwidth^2 / (K d^2)``: d is the
impedance at r, A = 1/m1 + 1/m2 as the engine has it, and s = 1 or, of a pyramidal cone, whose
2 (condim - 1) edges share the load, ``mu^2 (1 + mu^2) / ((condim - 1) impratio)``.
Source: MuJoCo's documentation, Computation, "Parameters", and mj_makeImpedance.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from contactlab.contact.contact_laws import (
    damping_ratio,
    damping_ratio_of,
    impedance,
    refsafe_solref,
    rest_penetration,
    restitution_of,
    stiffness_damping,
)
from contactlab.contact.trace_arrays import DISTANCE
from contactlab.errors import SceneError, SweepFileError
from contactlab.plan.validation import without_unit
from contactlab.run.evidence_record import as_written
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.setting_values import as_number
from contactlab.studies.session import Session, read_settings

WORDS = {"stiffness": "N/m", "depth_at_rest": "m", "restitution": ""}
_STABLE = 0.8  # largest step, times the contact's rate, by which no impact gains energy
_RESOLVED = 0.2  # likewise by which restitution is right within some percent
_AT_REST = ("contacts", "load", "depth")
_RESTING = 0.9  # share of the last fifth of a run in which a pair at rest touches
_AGREE = 0.1  # share by which what is measured may miss what is asked for


@dataclass(frozen=True)
class RestingPair:
    """A pair of contacts, what it bears at the end of a run, and how deep it is."""

    name: str
    solref: tuple[float, ...]
    solimp: tuple[float, ...]
    inverse_mass: float  # of both sides [1/kg], as the engine has it
    softness: float  # what its friction cone multiplies its depth by
    radius: float  # of the smaller geom [m]
    restitution: float | None  # measured in the run
    contacts: float = 0.0  # mean number in the last fifth of the run, if the pair rests then
    load: float = 0.0  # that one contact bears [N]
    depth: float = 0.0  # mean of the contacts, measured [m]

    @property
    def expected_depth(self) -> float:
        """The depth at which it bears its load, by the law [m]."""
        weight = self.softness * self.load
        return float(rest_penetration(weight, self.inverse_mass, self.solref, self.solimp))

    @property
    def largest_step(self) -> float:
        """The largest timestep that resolves it [s]: no gain of energy, and refsafe leaves it."""
        stable = _STABLE / float(np.sqrt(stiffness_damping(self.solref)[0]))
        return min(stable, self.solref[0] / 2) if self.solref[0] > 0 else stable

    def lines(self, timestep: float) -> list[str]:
        """Say its settings in units of the world."""
        (rate, drag), mass = stiffness_damping(self.solref), 1 / self.inverse_mass
        depth, zeta = self.expected_depth, damping_ratio(self.solref)
        rest = {"depth_at_rest": "it does not rest at the end of the run"}
        if self.load:
            bears = f"{self.load:.4g} N on each of {self.contacts:.3g} contacts"
            measured = f"measured {self.depth * 1e3:.4g} mm"
            rest = {
                "stiffness": f"{self.load / depth:.4g} N/m at rest, load over depth",
                "depth_at_rest": f"{depth * 1e3:.4g} mm under {bears}; {measured}",
            }
        most, now = self.largest_step * 1e3, timestep * 1e3
        said = {
            f"{self.name}:": f'solref="{" ".join(f"{each:.6g}" for each in self.solref)}"',
            **rest,
            "in an impact": f"{rate * mass:.4g} N/m, {drag * mass:.4g} N s/m, ratio {zeta:.4g}",
            "restitution": f"{restitution_of(zeta):.3g}, without gravity",
            "timestep": f"at most {most:.4g} ms; it is {now:.4g} ms",
        }
        return [f"{name:<14} {text}" for name, text in said.items()]

    def solved(self, words: Mapping[str, float]) -> tuple[float, float]:
        """Return the solref, in standard form, that has what is asked for; refused with why not."""
        stiffness, zeta = float(stiffness_damping(self.solref)[0]), damping_ratio(self.solref)
        if "restitution" in words:
            zeta = damping_ratio_of(words["restitution"])
        if words.keys() & {"stiffness", "depth_at_rest"}:
            depth = words.get("depth_at_rest") or self.load / words["stiffness"]
            if depth >= self.radius:
                raise SceneError(
                    f"{self.name}: {depth * 1e3:.3g} mm is deeper than the smaller geom, which "
                    f"reaches {self.radius * 1e3:.3g} mm"
                )
            d, end = float(impedance(depth, self.solimp)), self.solimp[1]
            weight = self.softness * self.load * self.inverse_mass
            stiffness = weight * (1 - d) * end**2 / (depth * d**2)
        return 1 / (float(zeta) * stiffness**0.5), float(zeta)


def read_words(assigned: Mapping[str, str]) -> dict[str, float]:
    """Return what is asked for in SI; a SweepFileError says how it is written."""
    words = dict[str, float]()
    for name, text in assigned.items():
        unit, most = WORDS[name], 1 if name == "restitution" else 1e300
        try:
            words[name] = (without_unit(text, unit) if unit else None) or float(text)
        except ValueError:
            words[name] = math.nan
        if not 0 < words[name] <= most:
            how = f" in {unit}" if unit else ", at most 1"
            raise SweepFileError(f"{name}={text}: write a number above 0{how}")
    if {"stiffness", "depth_at_rest"} <= words.keys():
        raise SweepFileError("stiffness and depth_at_rest set the same thing; give one of them")
    return words


def explain_contacts(
    model: str, assign: Sequence[str], words: Mapping[str, float], session: Session
) -> tuple[list[str], list[str]]:
    """Return what the contacts of a model are, or its settings for what is asked of them.

    What is asked for is verified by a run with the settings; the second list says what that does
    not show. Raises a SceneError if what is asked for has no meaning for the model.
    """
    scenes = SceneLoader(Path())
    if not scenes.open(model).base({}).pairs:
        raise SceneError(f"{model}: nothing touches at the start, and no `pairs` are named")
    pairs, timestep = _resting(model, assign, scenes, session)
    if not words:
        return [line for pair in pairs for line in pair.lines(timestep)], []
    if words.keys() & {"stiffness", "depth_at_rest"}:
        pairs = [each for each in pairs if each.load]
    if not pairs:
        raise SceneError(
            f"{model}: no pair rests at the end of the run, so that none has a depth or stiffness; "
            "give a restitution, or a model that comes to rest"
        )
    lines, missed = list[str](), list[str]()
    for pair in pairs:
        solref = " ".join(f"{each:.8g}" for each in pair.solved(words))
        found, _ = _resting(model, [*assign, f'solref="{solref}"'], scenes, session)
        again = next(each for each in found if each.name == pair.name)
        lines += again.lines(timestep)
        missed += _missed(again, words, timestep)
    return lines, missed


def _missed(pair: RestingPair, words: Mapping[str, float], timestep: float) -> Iterator[str]:
    """Say what a run does not show of what is asked for."""
    if timestep > pair.largest_step * (1 + 1e-9):
        yield f"{pair.name}: a timestep of {timestep:g} s is too long for it"
    found = {
        "stiffness": pair.load / pair.depth if pair.depth else 0.0,
        "depth_at_rest": pair.depth,
        "restitution": pair.restitution,
    }
    for name, size in found.items():
        asked = words.get(name)
        if asked is None:
            continue
        if size is None:
            yield f"{pair.name}: nothing bounces in the run, so restitution was not measured"
        elif abs(size - asked) > _AGREE * asked:
            why = f"; an impact takes a step of {_RESOLVED / _STABLE * pair.largest_step:.2g} s"
            unit = f" {WORDS[name]}".rstrip()
            yield (
                f"{pair.name}: {name} is {size:.4g}{unit}, not {asked:.4g}{unit}"
                f"{why * (name == 'restitution')}"
            )


def _resting(
    model: str, assign: Sequence[str], scenes: SceneLoader, session: Session
) -> tuple[list[RestingPair], float]:
    """Run a model with some settings; return its pairs, and its timestep [s]."""
    values, _ = read_settings(scenes, model, assign)
    axes = {name: [as_written(each)] for name, each in values.items()}
    sweep = {"version": 1, "scene": model, "axes": axes, "trace": "all", "checks": "none"}
    store, base = session.run_derived("run", sweep, scenes), scenes.open(model).base({})
    (record,) = store.records()
    trace, rests = store.trace(record), list[RestingPair]()
    fifth = (len(trace.time) - 1) // 5
    timestep = as_number(record.settings["timestep"])
    for pair in base.pairs:
        stored, used = trace.pair(pair.name), record.pairs[pair.name]
        last = stored.steps >= len(trace.time) - 1 - fifth
        count, loads = stored.contacts[last], stored.normal[last]
        points = stored.points[np.repeat(last, stored.contacts), DISTANCE]
        geoms = [side[0] for side in pair.geoms]
        inverse = float(base.model.body_invweight0[base.model.geom_bodyid[geoms], 0].sum())
        if not inverse:
            raise SceneError(f"{pair.name}: neither side can move, so that nothing is stiff")
        square, softness = used.friction[0] ** 2, 1.0
        if record.settings["cone"] == "pyramidal" and used.condim > 1:
            softness = square * (1 + square) / (used.condim - 1)
            softness /= as_number(record.settings["impratio"])
        safe, reach = record.effects.get("refsafe", True), base.model.geom_rbound[geoms]
        rests.append(
            RestingPair(
                name=pair.name,
                solref=refsafe_solref(used.solref, timestep) if safe else used.solref,
                solimp=used.solimp,
                inverse_mass=inverse,
                softness=softness,
                radius=float(np.where(reach > 0, reach, np.inf).min()),
                restitution=record.metrics.get("restitution_measured"),
            )
        )
        if last.sum() >= _RESTING * fifth:
            depth = used.margin - used.gap - float(points.mean())  # force begins at the margin
            means = float(count.mean()), float((loads / count).mean()), depth
            rests[-1] = replace(rests[-1], **dict(zip(_AT_REST, means, strict=True)))
    return rests, timestep
