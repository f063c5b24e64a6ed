"""Small safe expressions over named values: arithmetic, comparisons and a few functions.

Python's `ast` parses the text, which is then compiled to nested functions. Only the nodes that are
listed here are accepted. Numbers are computed as floats, so that no expression can run away:
`9**9**9` overflows at once.
"""

import ast
import math
import operator
import warnings
from collections.abc import Callable, Mapping

Result = float | bool | str
Evaluate = Callable[[Mapping[str, object]], Result]

_MAX_CHARACTERS = 1000


class ExpressionError(ValueError):
    """An expression cannot be parsed or evaluated.

    Attributes:
        start: where in the text the cause begins, counted from 0.
        width: its number of characters.
    """

    def __init__(self, message: str, start: int = 0, width: int = 1) -> None:
        super().__init__(message)
        self.start = start
        self.width = width


class NoValueError(ExpressionError):
    """A name that an expression uses has no value."""


class Expression:
    """An expression that is parsed once and evaluated for many sets of values.

    It may hold numbers, quoted words, names (dotted ones too), `+ - * / **`, comparisons,
    `and or not`, parentheses, the functions abs, min, max, sqrt, sin, cos, tan, exp, log, radians
    and degrees, and the constant pi. Angles are in radians.

    Attributes:
        text: as written.
        places: the names it uses, with the start of each one's first use.

    Raises:
        ExpressionError: the text is not such an expression.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.places: dict[str, int] = {}
        if len(text) > _MAX_CHARACTERS:
            raise ExpressionError(f"longer than {_MAX_CHARACTERS} characters", 0, len(text))
        try:
            self._evaluate = _Compiler(text, self.places).visit(_parse(text))
        except (RecursionError, MemoryError) as error:
            raise ExpressionError("nested too deeply", 0, len(text)) from error

    @property
    def names(self) -> tuple[str, ...]:
        """The names that it uses."""
        return tuple(self.places)

    def evaluate(self, values: Mapping[str, object]) -> Result:
        """Evaluate the expression.

        Raises:
            ExpressionError: a name has no value, or the result is not a finite number.
        """
        try:
            result = self._evaluate(values)
        except (ArithmeticError, TypeError) as error:
            raise ExpressionError(_reason(error), 0, len(self.text)) from error
        if isinstance(result, float) and not math.isfinite(result):
            raise ExpressionError("the result is not a finite number", 0, len(self.text))
        return result

    def __reduce__(self) -> tuple[type["Expression"], tuple[str]]:
        """Pickle as text."""
        return Expression, (self.text,)

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"


def _parse(text: str) -> ast.expr:
    """Return the syntax tree of a text without the spaces around it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Warning)
            return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError) as error:
        offset = error.offset if isinstance(error, SyntaxError) else None
        start = _indent(text) + offset - 1 if offset else len(text)
        raise ExpressionError("not an expression", min(start, len(text))) from error


def _indent(text: str) -> int:
    return len(text) - len(text.lstrip())


def _number(value: object) -> float:
    if isinstance(value, int | float):
        return float(value)
    raise TypeError(f"{value!r} is not a number")


def _power(base: float, exponent: float) -> float:
    result: float | complex = base**exponent
    if isinstance(result, complex):
        raise TypeError("a root of a negative number")
    return result


def _of_numbers(compute: Callable[[float, float], Result]) -> Callable[[Result, Result], Result]:
    return lambda left, right: compute(_number(left), _number(right))


def _reason(error: Exception) -> str:
    if isinstance(error, ZeroDivisionError):
        return "division by zero"
    return "a number is too large" if isinstance(error, OverflowError) else str(error)


_FUNCTIONS: dict[str, Callable[..., float]] = {
    "abs": math.fabs,
    "cos": math.cos,
    "degrees": math.degrees,
    "exp": math.exp,
    "log": math.log,
    "max": max,
    "min": min,
    "radians": math.radians,
    "sin": math.sin,
    "sqrt": math.sqrt,
    "tan": math.tan,
}
_UNARY: dict[type[ast.unaryop], Callable[[Result], Result]] = {
    ast.Not: operator.not_,
    ast.UAdd: _number,
    ast.USub: lambda value: -_number(value),
}
_ARITHMETIC: dict[type[ast.operator], Callable[[Result, Result], Result]] = {
    ast.Add: _of_numbers(operator.add),
    ast.Sub: _of_numbers(operator.sub),
    ast.Mult: _of_numbers(operator.mul),
    ast.Div: _of_numbers(operator.truediv),
    ast.Pow: _of_numbers(_power),
}
_COMPARISONS: dict[type[ast.cmpop], Callable[[Result, Result], Result]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: _of_numbers(operator.lt),
    ast.LtE: _of_numbers(operator.le),
    ast.Gt: _of_numbers(operator.gt),
    ast.GtE: _of_numbers(operator.ge),
}


class _Compiler(ast.NodeVisitor):
    """Turns syntax trees into nested functions of the values.

    Args:
        text: the whole expression.
        places: filled with every name that is used, with the start of its first use.
    """

    def __init__(self, text: str, places: dict[str, int]) -> None:
        self._text = text
        self._places = places

    def visit(self, node: ast.AST) -> Evaluate:
        return super().visit(node)

    def generic_visit(self, node: ast.AST) -> Evaluate:
        raise self._error(node, "only numbers, names, operators and functions are allowed here")

    def visit_Constant(self, node: ast.Constant) -> Evaluate:
        value = node.value
        if not isinstance(value, int | float | str):
            raise self._error(node, "only numbers and quoted words are literals here")
        try:
            fixed = value if isinstance(value, bool | str) else float(value)
        except OverflowError as error:
            raise self._error(node, "a number is too large") from error
        return lambda _: fixed

    def visit_Name(self, node: ast.Name | ast.Attribute) -> Evaluate:
        name = self._dotted(node)
        if name == "pi":
            return lambda _: math.pi
        if name in _FUNCTIONS:
            raise self._error(node, f"'{name}' is a function: write {name}(...)")
        start, width = self._span(node)
        self._places.setdefault(name, start)

        def read(values: Mapping[str, object]) -> Result:
            if name not in values:
                raise NoValueError(f"'{name}' has no value", start, width)
            value = values[name]
            if isinstance(value, bool | str):
                return value
            if isinstance(value, int | float):
                return float(value)
            raise ExpressionError(f"'{name}' is not a single number", start, width)

        return read

    def visit_Attribute(self, node: ast.Attribute) -> Evaluate:
        return self.visit_Name(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Evaluate:
        compute = _UNARY.get(type(node.op))
        if compute is None:
            raise self._error(node, "the unary operators are + - and not")
        operand = self.visit(node.operand)
        return lambda values: compute(operand(values))

    def visit_BinOp(self, node: ast.BinOp) -> Evaluate:
        compute = _ARITHMETIC.get(type(node.op))
        if compute is None:
            raise self._error(node, "the arithmetic operators are + - * / and **")
        left, right = self.visit(node.left), self.visit(node.right)
        return lambda values: compute(left(values), right(values))

    def visit_BoolOp(self, node: ast.BoolOp) -> Evaluate:
        terms = [self.visit(value) for value in node.values]
        stops_at = isinstance(node.op, ast.Or)

        def apply(values: Mapping[str, object]) -> Result:
            result: Result = not stops_at
            for term in terms:
                result = term(values)
                if bool(result) is stops_at:
                    break
            return result

        return apply

    def visit_Compare(self, node: ast.Compare) -> Evaluate:
        if not all(type(each) in _COMPARISONS for each in node.ops):
            raise self._error(node, "the comparisons are < <= > >= == and !=")
        tests = [_COMPARISONS[type(each)] for each in node.ops]
        first, *others = [self.visit(each) for each in (node.left, *node.comparators)]

        def apply(values: Mapping[str, object]) -> Result:
            left = first(values)
            for test, term in zip(tests, others, strict=True):
                right = term(values)
                if not test(left, right):
                    return False
                left = right
            return True

        return apply

    def visit_Call(self, node: ast.Call) -> Evaluate:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in _FUNCTIONS:
            raise self._error(node.func, "the functions are " + ", ".join(_FUNCTIONS))
        several = name in {"max", "min"}
        if node.keywords or (len(node.args) < 2 if several else len(node.args) != 1):
            takes = "two or more numbers" if several else "one number"
            raise self._error(node, f"{name} takes {takes}")
        function, terms = _FUNCTIONS[name], [self.visit(each) for each in node.args]

        def apply(values: Mapping[str, object]) -> Result:
            arguments = [_number(term(values)) for term in terms]
            try:
                return function(*arguments)
            except ValueError as error:
                raise ArithmeticError(f"{name} is not defined for this value") from error

        return apply

    def _dotted(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name):
            return node.id
        if isinstance(node, ast.Attribute):
            return f"{self._dotted(node.value)}.{node.attr}"
        raise self._error(node, "a dot only joins the parts of a name")

    def _error(self, node: ast.AST, message: str) -> ExpressionError:
        return ExpressionError(message, *self._span(node))

    def _span(self, node: ast.AST) -> tuple[int, int]:
        """Return start and width of a node in characters (the tree counts UTF-8 bytes)."""
        if not isinstance(node, ast.expr) or node.lineno != 1 or node.end_lineno != 1:
            return 0, len(self._text)
        line = self._text.strip().encode()
        start = len(line[: node.col_offset].decode())
        end = len(line[: node.end_col_offset].decode())
        return _indent(self._text) + start, end - start
