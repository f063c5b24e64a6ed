"""Contact settings in units of the world, and back: laws of rest and impact, shown by a run."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from contactlab.contact.contact_laws import (
    RESOLVED_STEP,
    STABLE_STEP,
    damping_ratio,
    damping_ratio_of,
    largest_step,
    refsafe_solref,
    rest_penetration,
    restitution_of,
    stiffness_damping,
)
from contactlab.contact.trace_arrays import DISTANCE
from contactlab.errors import SceneError, SweepFileError
from contactlab.mjcf import AT_REST
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.contact_at_rest import ContactAtRest, law_of_rest
from contactlab.schema.setting_values import as_number, without_unit
from contactlab.store.table_layout import as_written
from contactlab.studies.session import Session, read_settings

WORDS = {**AT_REST, "restitution": ""}
_MEANS = ("contacts", "load", "depth")
_RESTING = 0.9  # share of the last fifth of the first phase in which a pair at rest touches
_AGREE = 0.1  # share by which what is measured may miss what is asked for


@dataclass(frozen=True)
class RestingPair:
    """A pair of contacts, what it bears at rest, and how deep it is.

    That is measured at the end of the first phase of the task, before anything is excited.
    """

    law: ContactAtRest
    restitution: float | None  # measured in the run
    phase: str  # the first of the task
    contacts: float = 0.0  # mean number in the last fifth of that phase, if the pair rests then
    load: float = 0.0  # that one contact bears [N]
    depth: float = 0.0  # mean of the contacts, measured [m]

    @property
    def name(self) -> str:
        """The pair's name."""
        return self.law.name

    @property
    def expected_depth(self) -> float:
        """The depth at which it bears its load, by the law [m]."""
        law, weight = self.law, self.law.softness * self.load
        return float(rest_penetration(weight, law.inverse_mass, law.solref, law.solimp))

    def lines(self, timestep: float) -> list[str]:
        """Say its settings in units of the world."""
        solref, mass = self.law.solref, 1 / self.law.inverse_mass
        (rate, drag), zeta = stiffness_damping(solref), damping_ratio(solref)
        depth = self.expected_depth
        rest = {"depth_at_rest": f"it does not rest at the end of its {self.phase} phase"}
        if self.load:
            bears = f"{self.load:.4g} N on each of {self.contacts:.3g} contacts"
            measured = f"measured {self.depth * 1e3:.4g} mm"
            rest = {
                "stiffness": f"{self.load / depth:.4g} N/m at rest, load over depth",
                "depth_at_rest": f"{depth * 1e3:.4g} mm under {bears}; {measured}",
            }
        most, now = largest_step(solref) * 1e3, timestep * 1e3
        said = {
            f"{self.name}:": f'solref="{" ".join(f"{number:.6g}" for number in solref)}"',
            **rest,
            "in an impact": f"{rate * mass:.4g} N/m, {drag * mass:.4g} N s/m, ratio {zeta:.4g}",
            "restitution": f"{restitution_of(zeta):.3g}, without gravity",
            "timestep": f"at most {most:.4g} ms; it is {now:.4g} ms",
        }
        return [f"{name:<14} {text}" for name, text in said.items()]

    def solved(self, words: Mapping[str, float]) -> tuple[float, float]:
        """Return the solref, in standard form, that has what is asked for; refused with why not."""
        zeta = float(damping_ratio(self.law.solref))
        if "restitution" in words:
            zeta = float(damping_ratio_of(words["restitution"]))
        if not words.keys() & AT_REST.keys():
            return 1 / (zeta * float(stiffness_damping(self.law.solref)[0]) ** 0.5), zeta
        depth = words.get("depth_at_rest") or self.load / words["stiffness"]
        return self.law.solref_of(depth, self.load, zeta)


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
    model: str,
    assign: Sequence[str],
    words: Mapping[str, float],
    session: Session,
    options: TaskOptions = AS_INFERRED,
) -> tuple[list[str], list[str]]:
    """Return its task and what the contacts of a model are, or settings for what is asked of them.

    What is asked for is verified by a run with the settings; the second list says what that does
    not show. Raises a SceneError if what is asked for has no meaning for the model.
    """
    scenes, assign = SceneLoader(Path(), options.drive), [*assign, *options.settings]
    if not scenes.open(model).base({}).pairs:
        raise SceneError(f"{model}: nothing touches at the start, and no `pairs` are named")
    values, given = read_settings(scenes, model, assign, ("duration",))
    head = scenes.open(model).task(values, given.duration, seeds=(0,)).line
    pairs, timestep = _resting(model, assign, scenes, session)
    if not words:
        return [head, *(line for pair in pairs for line in pair.lines(timestep))], []
    if words.keys() & AT_REST.keys():
        pairs = [pair for pair in pairs if pair.load]
    if not pairs:
        raise SceneError(
            f"{model}: no pair rests at the end of the first phase, so that none has a depth or "
            "stiffness; give a restitution, or a model that comes to rest"
        )
    lines, missed = [head], list[str]()
    for pair in pairs:
        solref = " ".join(f"{number:.8g}" for number in pair.solved(words))
        found, _ = _resting(model, [*assign, f'solref="{solref}"'], scenes, session)
        again = next(solved for solved in found if solved.name == pair.name)
        lines += again.lines(timestep)
        missed += _missed(again, words, timestep)
    return lines, missed


def _missed(pair: RestingPair, words: Mapping[str, float], timestep: float) -> Iterator[str]:
    """Say what a run does not show of what is asked for."""
    most = largest_step(pair.law.solref)
    if timestep > most * (1 + 1e-9):
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
            why = f"; an impact takes a step of {RESOLVED_STEP / STABLE_STEP * most:.2g} s"
            unit = f" {WORDS[name]}".rstrip()
            yield (
                f"{pair.name}: {name} is {size:.4g}{unit}, not {asked:.4g}{unit}"
                f"{why * (name == 'restitution')}"
            )


def _resting(
    model: str, assign: Sequence[str], scenes: SceneLoader, session: Session
) -> tuple[list[RestingPair], float]:
    """Run a model with some settings; return its pairs, and its timestep [s]."""
    values, given = read_settings(scenes, model, assign, ("duration",))
    axes = {name: [as_written(value)] for name, value in values.items()}
    sweep = {"version": 1, "scene": model, "axes": axes, "trace": "all", "checks": "none"}
    sweep |= {} if given.duration is None else {"duration": given.duration}
    store, base = session.run_derived("run", sweep, scenes), scenes.open(model).base({})
    (record,) = store.records()
    trace, rests = store.trace(record), list[RestingPair]()
    task = scenes.open(model).task(values, given.duration, seeds=(0,))
    first = task.phases[0]
    end = round((len(trace.time) - 1) * first.end / task.duration)
    fifth = end // 5
    timestep = as_number(record.settings["timestep"])
    edited = base.prepare(scenes.open(model).resolve(values, 0, None).edits()).model
    for pair in base.pairs:
        stored, used = trace.pair(pair.name), record.pairs[pair.name]
        last = (stored.steps >= end - fifth) & (stored.steps < end)
        count, loads = stored.contacts[last], stored.normal[last]
        points = stored.points[np.repeat(last, stored.contacts), DISTANCE]
        safe = record.effects.get("refsafe", True)
        solref = refsafe_solref(used.solref, timestep) if safe else used.solref
        law = replace(law_of_rest(edited, pair, used), solref=solref)
        if not law.inverse_mass:
            raise SceneError(f"{pair.name}: neither side can move, so that nothing is stiff")
        rests.append(RestingPair(law, record.metrics.get("restitution_measured"), first.name))
        if last.sum() >= _RESTING * fifth:
            depth = used.margin - float(points.mean())  # force begins at the margin
            means = float(count.mean()), float((loads / count).mean()), depth
            rests[-1] = replace(rests[-1], **dict(zip(_MEANS, means, strict=True)))
    return rests, timestep
