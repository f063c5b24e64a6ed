"""Small safe expressions over named values: arithmetic, comparisons and a few functions.

Python parses the text, and evaluates it once every node of its tree is one of those that are listed
here. Numbers are computed as floats, so that no expression can run away: `9**9**9` overflows at
once.
"""

import ast
import math
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import ClassVar
from unicodedata import normalize

Result = float | bool | str


class ExpressionError(ValueError):
    """An expression cannot be parsed or evaluated.

    In the text, the cause has a start, counted from 0, and a width.
    """

    def __init__(self, message: str, start: int = 0, width: int = 1) -> None:
        super().__init__(message)
        self.start = start
        self.width = width


class NoValueError(ExpressionError):
    """A name that an expression uses has no value."""


class CheckedText:
    """Text that is parsed and checked once: an expression of this language or one like it.

    `places` has the names that it uses, with the start of each one's first use.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.places: dict[str, int] = {}
        most_characters = 1000
        if len(text) > most_characters:
            raise ExpressionError(f"longer than {most_characters} characters", 0, len(text))
        try:
            tree = ast.Expression(self._make_checker(text).visit(_parse_text(text)))
            self._code = compile(ast.fix_missing_locations(tree), "expression", "eval")
        except (RecursionError, MemoryError) as error:
            raise ExpressionError("nested too deeply", 0, len(text)) from error

    def _make_checker(self, text: str) -> "Checker":
        return Checker(text, self.places)

    @property
    def names(self) -> tuple[str, ...]:
        """The names that it uses."""
        return tuple(self.places)

    def __reduce__(self) -> tuple[type["CheckedText"], tuple[str]]:
        """Pickle as text."""
        return type(self), (self.text,)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.text!r})"


class Expression(CheckedText):
    """An expression that is parsed once and evaluated for many sets of values.

    It may hold numbers, quoted words, names (dotted ones too), `+ - * / **`, comparisons,
    `and or not`, parentheses, the functions abs, min, max, sqrt, sin, cos, tan, exp, log, radians
    and degrees, and the constant pi. Angles are in radians. Other text is an ExpressionError.
    """

    def evaluate(self, values: Mapping[str, object]) -> Result:
        """Return the result; an ExpressionError if a name has no value, or it is not finite."""

        def read(name: str) -> "float | bool | _Word":
            value, place = values.get(name), (self.places[name], len(name))
            if name not in values:
                raise NoValueError(f"'{name}' has no value", *place)
            if not isinstance(value, bool | int | float | str):
                raise ExpressionError(f"'{name}' is not a single number", *place)
            if isinstance(value, str):
                return _Word(value)
            return value if isinstance(value, bool) else float(value)

        try:
            # All that it can call is in these names.
            result = eval(self._code, {"__builtins__": {}, **_CALLED, "read": read})  # noqa: S307
        except (ArithmeticError, TypeError) as error:
            raise ExpressionError(_explain_error(error), 0, len(self.text)) from error
        if isinstance(result, _Word | bool):
            return result.text if isinstance(result, _Word) else result
        if not math.isfinite(result):
            raise ExpressionError("the result is not a finite number", 0, len(self.text))
        return float(result)


def _parse_text(text: str) -> ast.expr:
    """Return the syntax tree of a text without the spaces around it."""
    for place, letter in enumerate(text):
        # Python reads such a letter or digit as the plain one that looks like it.
        if not letter.isascii() and (plain := normalize("NFKC", letter)).isascii():
            raise ExpressionError(f"'{letter}' is not the plain letter; write '{plain}'", place)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Warning)
            return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError) as error:
        offset = error.offset if isinstance(error, SyntaxError) else None
        start = _count_spaces(text) + offset - 1 if offset else len(text)
        raise ExpressionError(
            "not an expression; write one such as timestep > 1e-3", min(start, len(text))
        ) from error


def _count_spaces(text: str) -> int:
    return len(text) - len(text.lstrip())


@dataclass(frozen=True)
class _Word:
    """Text, which can be compared, but neither counted nor ordered."""

    text: str


def _raise_power(base: float, exponent: float) -> float:
    result: float | complex = float(base) ** exponent
    if isinstance(result, complex):
        raise ArithmeticError("a root of a negative number")
    return result


def _explain_error(error: Exception) -> str:
    if isinstance(error, TypeError):
        return "a word is not a number"
    if isinstance(error, ZeroDivisionError):
        return "division by zero"
    return "a number is too large" if isinstance(error, OverflowError) else str(error)


def _name_errors(name: str, function: Callable[..., float]) -> Callable[..., float]:
    """Return a function with errors that name it."""

    def apply(*arguments: float) -> float:
        try:
            return function(*arguments)
        except ValueError as error:
            raise ArithmeticError(f"{name} is not defined for this value") from error

    return apply


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
_CALLED = {name: _name_errors(name, function) for name, function in _FUNCTIONS.items()} | {
    "power": _raise_power,
    "word": _Word,
}
_OPERATORS: dict[type[ast.AST], tuple[tuple[type[ast.AST], ...], str]] = {
    ast.UnaryOp: ((ast.Not, ast.UAdd, ast.USub), "the unary operators are + - and not"),
    ast.BinOp: (
        (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow),
        "the arithmetic operators are + - * / and **",
    ),
    ast.BoolOp: ((ast.And, ast.Or), ""),
    ast.Compare: (
        (ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE),
        "the comparisons are < <= > >= == and !=",
    ),
}
"""By node, the operators that it may have, and the message on others."""


def call(name: str, *arguments: ast.expr) -> ast.expr:
    """Return the node of a call."""
    return ast.Call(ast.Name(name, ast.Load()), list(arguments), [])


class Checker(ast.NodeTransformer):
    """Refuses unlisted syntax; replaces names, words and powers by calls, and notes the names.

    A language of more functions than these has a checker with their names, which says of each
    whether it has the right arguments.
    """

    functions: ClassVar[Collection[str]] = tuple(_FUNCTIONS)

    def __init__(self, text: str, places: dict[str, int]) -> None:
        self._text = text
        self._places = places

    def generic_visit(self, node: ast.AST) -> ast.AST:
        """Return an operation of those that are listed."""
        if isinstance(node, ast.operator | ast.unaryop | ast.boolop | ast.cmpop):
            return node
        if not isinstance(node, ast.UnaryOp | ast.BinOp | ast.BoolOp | ast.Compare):
            raise self._make_error(
                node, "only numbers, names, operators and functions are allowed here"
            )
        allowed, message = _OPERATORS[type(node)]
        operators = node.ops if isinstance(node, ast.Compare) else [node.op]
        if not all(isinstance(operator, allowed) for operator in operators):
            raise self._make_error(node, message)
        return super().generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        """Return a float, a truth value or a word."""
        value = node.value
        if isinstance(value, str):
            return call("word", node)
        if not isinstance(value, int | float):
            raise self._make_error(node, "only numbers and quoted words are literals here")
        try:
            return ast.Constant(value if isinstance(value, bool) else float(value))
        except OverflowError as error:
            raise self._make_error(node, "a number is too large") from error

    def visit_Name(self, node: ast.Name | ast.Attribute) -> ast.expr:
        """Return the call that reads a name, and note its place."""
        name = self._dotted_name(node)
        if name == "pi":
            return ast.Constant(math.pi)
        if name in self.functions:
            raise self._make_error(node, f"'{name}' is a function: write {name}(...)")
        self._places.setdefault(name, self._node_span(node)[0])
        return call("read", ast.Constant(name))

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        """Return the call that reads a dotted name."""
        return self.visit_Name(node)

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Return the operation, or the call that a power is."""
        checked = self.generic_visit(node)
        return call("power", node.left, node.right) if isinstance(node.op, ast.Pow) else checked

    def visit_Call(self, node: ast.Call) -> ast.expr:
        """Return a call of a function that is listed, with as many arguments as it takes."""
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in self.functions:
            raise self._make_error(node.func, "the functions are " + ", ".join(self.functions))
        if node.keywords or not self._accepts_count(name, len(node.args)):
            raise self._make_error(node, f"{name} takes {self._describe_arguments(name)}")
        return call(name, *[self.visit(argument) for argument in node.args])

    def _accepts_count(self, name: str, count: int) -> bool:
        return count >= 2 if name in {"max", "min"} else count == 1

    def _describe_arguments(self, name: str) -> str:
        return "two or more numbers" if name in {"max", "min"} else "one number"

    def _dotted_name(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name):
            return node.id
        if isinstance(node, ast.Attribute):
            return f"{self._dotted_name(node.value)}.{node.attr}"
        raise self._make_error(node, "a dot only joins the parts of a name")

    def _make_error(self, node: ast.AST, message: str) -> ExpressionError:
        return ExpressionError(message, *self._node_span(node))

    def _node_span(self, node: ast.AST) -> tuple[int, int]:
        """Return start and width of a node in characters (the tree counts UTF-8 bytes)."""
        if not isinstance(node, ast.expr) or node.lineno != 1 or node.end_lineno != 1:
            return 0, len(self._text)
        line = self._text.strip().encode()
        start = len(line[: node.col_offset].decode())
        end = len(line[: node.end_col_offset].decode())
        return _count_spaces(self._text) + start, end - start
