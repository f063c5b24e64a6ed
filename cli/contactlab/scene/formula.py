"""Expressions of a manifest over the scene's initial values."""

from collections.abc import Mapping

from contactlab.errors import SceneError
from contactlab.expression import Expression, ExpressionError
from contactlab.schema import SceneManifest, Term


def read_formula(term: Term, where: str, manifest: SceneManifest) -> Expression:
    """Return a number or an expression of a manifest, ready to compute.

    Args:
        term: as written.
        where: where it stands, for messages.
        manifest: names the initial values.

    Raises:
        SceneError: it is no expression, or reads what is not an initial value.
    """
    try:
        expression = Expression(str(term))
    except ExpressionError as error:
        raise SceneError(f"{where} to '{term}': {error}") from error
    unknown = ", ".join(sorted(set(expression.names) - set(manifest.initial)))
    if unknown:
        known = ", ".join(manifest.initial) or "a number: the scene has no initial values"
        raise SceneError(f"{where} from unknown {unknown}; write one of {known}")
    return expression


def computed(formula: Expression, initial: Mapping[str, float]) -> float:
    """Return an expression's value for the initial values of a run.

    Raises:
        SceneError: it has none, or none that is a number.
    """
    try:
        result = formula.evaluate(initial)
    except ExpressionError as error:
        raise SceneError(f"cannot compute '{formula.text}' for {dict(initial)}: {error}") from error
    if not isinstance(result, float):
        raise SceneError(f"'{formula.text}' is {result!r}, not a number")
    return result
