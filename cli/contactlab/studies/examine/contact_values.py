"""Contact settings for a depth, a stiffness or a restitution, verified by a run."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

from contactlab.contact.contact_laws import RESOLVED_STEP, STABLE_STEP, largest_step
from contactlab.errors import SceneError, SweepFileError
from contactlab.mjcf import AT_REST
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.schema.examination import RestingContact
from contactlab.schema.setting_values import parse_decimal, without_unit
from contactlab.studies.examine.resting_contacts import RestingPair, resting_contacts, resting_pairs
from contactlab.tasks.checked_model import CheckedModel, open_model
from contactlab.tasks.session import Session

VALUES = {**AT_REST, "restitution": ""}


def read_values(assigned: Mapping[str, str]) -> dict[str, float]:
    """Return the requested values in SI; a SweepFileError says how to write them."""
    words = dict[str, float]()
    for name, text in assigned.items():
        unit, most = VALUES[name], 1 if name == "restitution" else 1e300
        try:
            words[name] = (without_unit(text, unit) if unit else None) or parse_decimal(text)
        except ValueError:
            words[name] = math.nan
        if not 0 < words[name] <= most:
            how = f" in {unit}" if unit else ", at most 1"
            raise SweepFileError(f"{name}={text}: write a number above 0{how}")
    if {"stiffness", "depth_at_rest"} <= words.keys():
        raise SweepFileError("stiffness and depth_at_rest set the same value; give one of them")
    return words


def split_values(assign: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return the settings of `--set`, and the requested values of contacts by name."""
    parts = [each.partition("=") for each in assign]
    values = {name: text for name, _, text in parts if name in VALUES}
    return [f"{name}{equals}{text}" for name, equals, text in parts if name not in VALUES], values


def measure_contacts(
    model: str,
    assign: Sequence[str],
    values: Mapping[str, str],
    session: Session,
    options: TaskOptions = AS_INFERRED,
    opened: Callable[[], None] = lambda: None,
) -> tuple[CheckedModel, tuple[RestingContact, ...], tuple[str, ...]]:
    """Return a model, its contacts or those with settings for requested values, and missed values.

    A run with the settings verifies the values; those that it does not reach are missed. `opened`
    is called once the model and its settings are read, before anything is run.

    Raises:
        SceneError: the values have no meaning for the model.
    """
    words = read_values(values)

    def with_settings(*more: str) -> CheckedModel:
        return open_model(model, session, options, [*assign, *more], rows=())

    examined = with_settings()
    examined.check_timestep()
    opened()
    if not examined.base.pairs:
        raise SceneError(
            f"{model}: no contact occurs in short runs from its start. Choose another start with "
            "--keyframe, or list `pairs` in a scene.yaml next to the model"
        )
    if not words:
        return examined, tuple(resting_contacts(examined)), ()
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
        solref = " ".join(f"{number:.8g}" for number in pair.solve_softness(words))
        changed = with_settings(f'solref="{solref}"')
        again = next(
            same_pair for same_pair in resting_pairs(changed) if same_pair.law.name == pair.law.name
        )
        timestep = changed.resolved.timestep
        contacts.append(again.contact(timestep))
        missed += _missed_values(again, words, timestep)
    return examined, tuple(contacts), tuple(missed)


def _missed_values(pair: RestingPair, words: Mapping[str, float], timestep: float) -> Iterator[str]:
    most = largest_step(pair.law.solref)
    if timestep > most * (1 + SUM_ROUNDING):
        yield f"{pair.name}: a timestep of {timestep:g} s is too long for these values"
    sizes = {
        "stiffness": pair.load / pair.depth if pair.depth else 0.0,
        "depth_at_rest": pair.depth,
        "restitution": pair.restitution,
    }
    largest_miss = 0.1  # largest difference of measured from requested values, as a share
    for name, size in sizes.items():
        requested = words.get(name)
        if requested is None:
            continue
        if size is None:
            yield f"{pair.name}: does not bounce in the run, so restitution was not measured"
        elif abs(size - requested) > largest_miss * requested:
            why = f"; an impact takes a step of {RESOLVED_STEP / STABLE_STEP * most:.2g} s"
            unit = f" {VALUES[name]}".rstrip()
            yield (
                f"{pair.name}: {name} is {size:.4g}{unit}, not {requested:.4g}{unit}"
                f"{why * (name == 'restitution')}"
            )
