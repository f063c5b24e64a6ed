"""Small safe expressions over named values: arithmetic, comparisons and a few functions.

Numbers are computed as floats, so that no expression can run away: `9**9**9` overflows at once.
"""

import math
from collections.abc import Mapping

from contactlab.plan.term import ExpressionError, Reader, Result


class Expression:
    """An expression that is read once and computed for many sets of values.

    It may hold numbers, quoted words, names (dotted ones too), `+ - * / **`, comparisons,
    `and or not`, parentheses, the functions abs, min, max, sqrt, sin, cos, tan, exp, log, radians
    and degrees, and the constant pi. Angles are in radians.

    Attributes:
        text: as written.
        places: the names it reads, with where each first begins.

    Raises:
        ExpressionError: the text is not such an expression.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.places: dict[str, int] = {}
        self._term = Reader(text, self.places).read()

    @property
    def names(self) -> tuple[str, ...]:
        """Names that it reads."""
        return tuple(self.places)

    def evaluate(self, values: Mapping[str, object]) -> Result:
        """Compute it.

        Raises:
            ExpressionError: a name has no value, or the result is not a finite number.
        """
        try:
            result = self._term(values)
        except (ArithmeticError, TypeError) as error:
            raise ExpressionError(f"{_reason(error)}", 0, len(self.text)) from error
        if isinstance(result, float) and not math.isfinite(result):
            raise ExpressionError("the result is not a finite number", 0, len(self.text))
        return result

    def __reduce__(self) -> tuple[type["Expression"], tuple[str]]:
        """Travel to another process as text."""
        return Expression, (self.text,)

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"


def _reason(error: Exception) -> str:
    if isinstance(error, ZeroDivisionError):
        return "division by zero"
    return "a number grows too large" if isinstance(error, OverflowError) else str(error)
