"""Finds the advisories that a model meets under an engine."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import mujoco

from contactlab.advisories.advisory_files import list_advisories
from contactlab.advisories.field_expressions import (
    FieldExpression,
    ModelFacts,
)
from contactlab.expression import NoValueError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.scene.model_xml import Elements
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.advisory import Advisory


class InstalledEngine(NamedTuple):
    """Name and version of the engine that simulates a model."""

    name: str = MODEL_ENGINE
    version: str = VERSION


def may_meet(advisory: Advisory, facts: ModelFacts) -> bool:
    """Return whether a model may meet the fault; not if this MuJoCo lacks its fields."""
    return not find_obstacle("applies", advisory.applies, facts)


def can_act(advisory: Advisory, facts: ModelFacts) -> bool:
    """Return whether the fault of an advisory can act in a state; not if its fields are missing."""
    return not advisory.occurs or not find_obstacle("occurs", advisory.occurs, facts)


def find_obstacle(key: str, predicate: str, facts: ModelFacts) -> str:
    """Return why a predicate does not hold, with the key of its advisory; empty if it does."""
    try:
        return "" if FieldExpression(predicate).evaluate_facts(facts) else f"{key} is false"
    except NoValueError as error:
        return f"{key}: {error}"


def find_met_advisories(
    model: mujoco.MjModel,
    engine: InstalledEngine = InstalledEngine(),  # noqa: B008 - immutable
    elements: Callable[[], Elements] | None = None,
    advisories: Iterable[Advisory] | None = None,
) -> tuple[Advisory, ...]:
    """Return the advisories that a compiled model meets under an engine, by id.

    Args:
        model: the compiled model.
        engine: the engine that simulates it.
        elements: returns those of the model's files, if these are known.
        advisories: by default those of contactlab and of installed packages.
    """
    facts = ModelFacts(model, list_elements=elements)
    return tuple(
        advisory
        for advisory in (list_advisories() if advisories is None else advisories)
        if advisory.engine == engine.name
        and advisory.affects_release(engine.version)
        and may_meet(advisory, facts)
    )


def describe_met_advisory(
    advisory: Advisory,
    engine: InstalledEngine = InstalledEngine(),  # noqa: B008 - immutable
    *,
    verb: str = "",
    where: str = "",
) -> str:
    """Say in a sentence that a model meets an advisory, where it does, and how to avoid the fault.

    Without a verb, a model may meet a fault that occurs in some states only.
    """
    verb = verb or ("may meet" if advisory.occurs else "meets")
    fixed = advisory.find_fixed_release(engine.version)
    state = f"fixed in {fixed}" if fixed else "not fixed yet"
    facts = f"{advisory.severity} in {advisory.engine} {engine.version}, {state}"
    return f"{verb} {advisory.id}{where} ({facts}): {advisory.title}; {describe_remedy(advisory)}"


def describe_remedy(advisory: Advisory) -> str:
    """Return the settings that avoid the fault of an advisory, or its advice."""
    if not advisory.workarounds:
        return advisory.advice
    settings = advisory.workarounds[0].settings.items()
    return f"avoided by {' '.join(f'{name}={value}' for name, value in settings)}"
