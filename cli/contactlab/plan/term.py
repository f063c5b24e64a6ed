"""The terms of an expression: its syntax tree turned into nested functions."""

import ast
import math
import operator
import warnings
from collections.abc import Callable, Mapping
from typing import cast

Result = float | bool | str
Term = Callable[[Mapping[str, object]], Result]

MOST_CHARACTERS = 1000
CONSTANTS = {"pi": math.pi}
FUNCTIONS: dict[str, Callable[..., float]] = {
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
_SEVERAL = {"max", "min"}
_ARITHMETIC: dict[type[ast.operator], Callable[[float, float], object]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_EQUALITY: dict[type[ast.cmpop], Callable[[object, object], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_ORDER: dict[type[ast.cmpop], Callable[[float, float], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


class ExpressionError(ValueError):
    """An expression cannot be read or computed.

    Attributes:
        start: where in the text the cause begins, counted from 0.
        width: its number of characters.
    """

    def __init__(self, message: str, start: int = 0, width: int = 1) -> None:
        super().__init__(message)
        self.start = start
        self.width = width


def _number(value: object) -> float:
    if isinstance(value, int | float):
        return float(value)
    raise TypeError(f"{value!r} is not a number")


class NoValueError(ExpressionError):
    """A name that an expression reads has no value."""


class Reader:
    """Turns the syntax tree of one expression into nested functions.

    Args:
        text: the expression.
        places: gets every name that is read, with where it first begins.
    """

    def __init__(self, text: str, places: dict[str, int]) -> None:
        self._indent = len(text) - len(text.lstrip())
        self._text = text
        self._places = places
        self._readers = {
            ast.Constant: self._constant,
            ast.Name: self._name,
            ast.Attribute: self._name,
            ast.UnaryOp: self._unary,
            ast.BinOp: self._binary,
            ast.BoolOp: self._junction,
            ast.Compare: self._comparison,
            ast.Call: self._call,
        }

    def read(self) -> Term:
        """Return the whole text as one function of the values."""
        if len(self._text) > MOST_CHARACTERS:
            raise ExpressionError(f"longer than {MOST_CHARACTERS} characters", 0, len(self._text))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", Warning)
                tree = ast.parse(self._text.strip(), mode="eval")
            return self._term(tree.body)
        except SyntaxError as error:
            start = self._indent + error.offset - 1 if error.offset else len(self._text)
            raise ExpressionError("not an expression", min(start, len(self._text))) from error
        except (RecursionError, MemoryError) as error:
            raise ExpressionError("nested too deeply", 0, len(self._text)) from error
        except ExpressionError:
            raise
        except ValueError as error:
            raise ExpressionError("not an expression", 0, len(self._text)) from error

    def _fail(self, node: ast.AST, message: str) -> ExpressionError:
        start, end = self._span(node)
        return ExpressionError(message, start, end - start)

    def _span(self, node: ast.AST) -> tuple[int, int]:
        """Return where a node begins and ends, in characters (the tree counts UTF-8 bytes)."""
        if not isinstance(node, ast.expr) or node.lineno != 1 or node.end_lineno != 1:
            return 0, len(self._text)
        line = self._text.strip().encode()
        begin = len(line[: node.col_offset].decode())
        end = len(line[: node.end_col_offset].decode())
        return self._indent + begin, self._indent + end

    def _term(self, node: ast.expr) -> Term:
        readers = cast("dict[type[ast.expr], Callable[[ast.expr], Term]]", self._readers)
        if type(node) not in readers:
            raise self._fail(node, "only numbers, names, operators and functions go here")
        return readers[type(node)](node)

    def _constant(self, node: ast.Constant) -> Term:
        value = node.value
        if not isinstance(value, int | float | str):
            raise self._fail(node, "only numbers and quoted words can be written out")
        try:
            fixed = value if isinstance(value, bool | str) else float(value)
        except OverflowError as error:
            raise self._fail(node, "a number grows too large") from error
        return lambda _: fixed

    def _name(self, node: ast.expr) -> Term:
        name = self._dotted(node)
        if name in CONSTANTS:
            constant = CONSTANTS[name]
            return lambda _: constant
        if name in FUNCTIONS:
            raise self._fail(node, f"'{name}' is a function: write {name}(...)")
        start, end = self._span(node)
        self._places.setdefault(name, start)

        def read(values: Mapping[str, object]) -> Result:
            try:
                value = values[name]
            except KeyError as error:
                raise NoValueError(f"'{name}' has no value", start, end - start) from error
            if value.__class__ is float or isinstance(value, bool | str):
                return cast("Result", value)
            try:
                return _number(value)
            except TypeError as error:
                raise ExpressionError(f"'{name}' is not one number", start, end - start) from error

        return read

    def _dotted(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name):
            return node.id
        if isinstance(node, ast.Attribute):
            return f"{self._dotted(node.value)}.{node.attr}"
        raise self._fail(node, "a dot only joins the parts of a name")

    def _unary(self, node: ast.UnaryOp) -> Term:
        operand = self._term(node.operand)
        match node.op:
            case ast.Not():
                return lambda values: not operand(values)
            case ast.USub():
                return lambda values: -_number(operand(values))
            case ast.UAdd():
                return lambda values: _number(operand(values))
            case _:
                raise self._fail(node, "this operator is not part of expressions")

    def _binary(self, node: ast.BinOp) -> Term:
        compute = _ARITHMETIC.get(type(node.op))
        if compute is None:
            raise self._fail(node, "arithmetic here is + - * / and **")
        left, right = self._term(node.left), self._term(node.right)

        def apply(values: Mapping[str, object]) -> Result:
            result = compute(_number(left(values)), _number(right(values)))
            if isinstance(result, complex):
                raise TypeError("a root of a negative number")
            return cast("float", result)

        return apply

    def _junction(self, node: ast.BoolOp) -> Term:
        terms = [self._term(value) for value in node.values]
        stops_at = isinstance(node.op, ast.Or)

        def apply(values: Mapping[str, object]) -> Result:
            result: Result = not stops_at
            for term in terms:
                result = term(values)
                if bool(result) is stops_at:
                    break
            return result

        return apply

    def _comparison(self, node: ast.Compare) -> Term:
        terms = [self._term(value) for value in (node.left, *node.comparators)]
        tests = [self._test(node, comparison) for comparison in node.ops]

        def apply(values: Mapping[str, object]) -> Result:
            left = terms[0](values)
            for test, term in zip(tests, terms[1:], strict=True):
                right = term(values)
                if not test(left, right):
                    return False
                left = right
            return True

        return apply

    def _test(self, node: ast.Compare, comparison: ast.cmpop) -> Callable[[Result, Result], bool]:
        if type(comparison) in _EQUALITY:
            return _EQUALITY[type(comparison)]
        order = _ORDER.get(type(comparison))
        if order is None:
            raise self._fail(node, "comparisons here are < <= > >= == and !=")
        return lambda left, right: order(_number(left), _number(right))

    def _call(self, node: ast.Call) -> Term:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in FUNCTIONS:
            raise self._fail(node.func, "the functions are " + ", ".join(sorted(FUNCTIONS)))
        if node.keywords or (len(node.args) < 2 if name in _SEVERAL else len(node.args) != 1):
            takes = "two or more numbers" if name in _SEVERAL else "one number"
            raise self._fail(node, f"{name} takes {takes}")
        function, terms = FUNCTIONS[name], [self._term(part) for part in node.args]

        def apply(values: Mapping[str, object]) -> Result:
            try:
                return function(*[_number(term(values)) for term in terms])
            except ValueError as error:
                if isinstance(error, ExpressionError):
                    raise
                raise ArithmeticError(f"{name} is not defined there") from error

        return apply
