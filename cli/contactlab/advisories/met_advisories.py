"""Finds the advisories that a model meets under an engine."""

from collections.abc import Iterable
from typing import NamedTuple

import mujoco

from contactlab.advisories.advisory_files import list_advisories
from contactlab.advisories.field_expressions import Elements, FieldExpression, ModelFacts
from contactlab.expression import NoValueError
from contactlab.mjcf import MODEL_ENGINE
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.advisory import Advisory


class InstalledEngine(NamedTuple):
    """Name and version of the engine that simulates a model."""

    name: str = MODEL_ENGINE
    version: str = VERSION


def may_meet(advisory: Advisory, facts: ModelFacts) -> bool:
    """Return whether a model may meet the fault; not if this MuJoCo lacks what it is about."""
    try:
        return bool(FieldExpression(advisory.applies).evaluate(facts))
    except NoValueError:
        return False


def find_met_advisories(
    model: mujoco.MjModel,
    engine: InstalledEngine = InstalledEngine(),  # noqa: B008 - immutable
    elements: Elements | None = None,
    advisories: Iterable[Advisory] | None = None,
) -> tuple[Advisory, ...]:
    """Return the advisories that a compiled model meets under an engine, by id.

    Args:
        model: the compiled model.
        engine: the engine that simulates it.
        elements: of the model's files, if these are known.
        advisories: by default those of contactlab and of installed packages.
    """
    facts = ModelFacts(model, elements=elements)
    return tuple(
        advisory
        for advisory in (list_advisories() if advisories is None else advisories)
        if advisory.engine == engine.name
        and advisory.affects(engine.version)
        and may_meet(advisory, facts)
    )
