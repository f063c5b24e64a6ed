"""Contact settings for a depth, a stiffness or a restitution, verified by a run."""

import math
from collections.abc import Iterator, Mapping, Sequence

from contactlab.contact.contact_laws import RESOLVED_STEP, STABLE_STEP, largest_step
from contactlab.errors import SceneError, SweepFileError
from contactlab.mjcf import AT_REST
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.schema.examination import RestingContact
from contactlab.schema.explanation import Explanation
from contactlab.schema.setting_values import without_unit
from contactlab.studies.examine.resting_contacts import RestingPair, resting_contacts, resting_pairs
from contactlab.tasks.checked_model import CheckedModel, open_model
from contactlab.tasks.session import Session

WORDS = {**AT_REST, "restitution": ""}


def read_words(assigned: Mapping[str, str]) -> dict[str, float]:
    """Return the requested values in SI; a SweepFileError says how to write them."""
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
        raise SweepFileError("stiffness and depth_at_rest set the same value; give one of them")
    return words


def explain_contacts(
    model: str,
    assign: Sequence[str],
    words: Mapping[str, float],
    session: Session,
    options: TaskOptions = AS_INFERRED,
) -> Explanation:
    """Return the contacts of a model, or those with settings for requested values.

    A run with the settings verifies the values; the report names those that it does not reach.

    Raises:
        SceneError: the values have no meaning for the model.
    """

    def with_settings(*more: str) -> CheckedModel:
        return open_model(model, session, options, [*assign, *more])

    examined = with_settings()
    if not examined.base.pairs:
        raise SceneError(
            f"{model}: no contact occurs in short runs from its start. Choose another start with "
            "--keyframe, or list `pairs` in a scene.yaml next to the model"
        )
    head = examined.task.line
    if not words:
        return Explanation(task=head, contacts=tuple(resting_contacts(examined)))
    pairs = list(resting_pairs(examined))
    if words.keys() & AT_REST.keys():
        pairs = [pair for pair in pairs if pair.load]
    if not pairs:
        raise SceneError(
            f"{model}: no pair rests at the end of the first phase, so there is no depth or "
            "stiffness. Give a restitution, or a model that comes to rest"
        )
    contacts, missed = list[RestingContact](), list[str]()
    for pair in pairs:
        solref = " ".join(f"{number:.8g}" for number in pair.solved(words))
        changed = with_settings(f'solref="{solref}"')
        again = next(found for found in resting_pairs(changed) if found.law.name == pair.law.name)
        timestep = changed.resolved.timestep
        contacts.append(again.contact(timestep))
        missed += _missed_values(again, words, timestep)
    return Explanation(
        task=head, contacts=tuple(contacts), requested=tuple(words), missed=tuple(missed)
    )


def _missed_values(pair: RestingPair, words: Mapping[str, float], timestep: float) -> Iterator[str]:
    """Yield the requested values that a run does not reach."""
    most = largest_step(pair.law.solref)
    if timestep > most * (1 + SUM_ROUNDING):
        yield f"{pair.name}: a timestep of {timestep:g} s is too long for these values"
    found = {
        "stiffness": pair.load / pair.depth if pair.depth else 0.0,
        "depth_at_rest": pair.depth,
        "restitution": pair.restitution,
    }
    largest_miss = 0.1  # largest difference of measured from requested values, as a share
    for name, size in found.items():
        asked = words.get(name)
        if asked is None:
            continue
        if size is None:
            yield f"{pair.name}: does not bounce in the run, so restitution was not measured"
        elif abs(size - asked) > largest_miss * asked:
            why = f"; an impact takes a step of {RESOLVED_STEP / STABLE_STEP * most:.2g} s"
            unit = f" {WORDS[name]}".rstrip()
            yield (
                f"{pair.name}: {name} is {size:.4g}{unit}, not {asked:.4g}{unit}"
                f"{why * (name == 'restitution')}"
            )
