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
_CONSTANTS = {"pi": math.pi}
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
_VARIADIC = {"max", "min"}
_ARITHMETIC: dict[type[ast.operator], Callable[[float, float], float | complex]] = {
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


class NoValueError(ExpressionError):
    """A name that an expression reads has no value."""


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
        self._evaluate = _Compiler(text, self.places).compile()

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
            result = self._evaluate(values)
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


class _Compiler:
    """Turns the syntax tree of one expression into nested functions.

    Args:
        text: the expression.
        places: gets every name that is read, with where it first begins.
    """

    def __init__(self, text: str, places: dict[str, int]) -> None:
        self._indent = len(text) - len(text.lstrip())
        self._text = text
        self._places = places

    def compile(self) -> Evaluate:
        """Return the whole text as one function of the values."""
        if len(self._text) > _MAX_CHARACTERS:
            raise ExpressionError(f"longer than {_MAX_CHARACTERS} characters", 0, len(self._text))
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

    def _term(self, node: ast.expr) -> Evaluate:
        match node:
            case ast.Constant():
                term = self._constant(node)
            case ast.Name() | ast.Attribute():
                term = self._name(node)
            case ast.UnaryOp():
                term = self._unary(node)
            case ast.BinOp():
                term = self._binary(node)
            case ast.BoolOp():
                term = self._boolean(node)
            case ast.Compare():
                term = self._comparison(node)
            case ast.Call():
                term = self._call(node)
            case _:
                raise self._fail(node, "only numbers, names, operators and functions go here")
        return term

    def _constant(self, node: ast.Constant) -> Evaluate:
        value = node.value
        if not isinstance(value, int | float | str):
            raise self._fail(node, "only numbers and quoted words can be written out")
        try:
            fixed = value if isinstance(value, bool | str) else float(value)
        except OverflowError as error:
            raise self._fail(node, "a number grows too large") from error
        return lambda _: fixed

    def _name(self, node: ast.expr) -> Evaluate:
        name = self._dotted(node)
        if name in _CONSTANTS:
            constant = _CONSTANTS[name]
            return lambda _: constant
        if name in _FUNCTIONS:
            raise self._fail(node, f"'{name}' is a function: write {name}(...)")
        start, end = self._span(node)
        self._places.setdefault(name, start)

        def read(values: Mapping[str, object]) -> Result:
            try:
                value = values[name]
            except KeyError as error:
                raise NoValueError(f"'{name}' has no value", start, end - start) from error
            if type(value) is float or isinstance(value, bool | str):
                return value
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

    def _unary(self, node: ast.UnaryOp) -> Evaluate:
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

    def _binary(self, node: ast.BinOp) -> Evaluate:
        compute = _ARITHMETIC.get(type(node.op))
        if compute is None:
            raise self._fail(node, "arithmetic here is + - * / and **")
        left, right = self._term(node.left), self._term(node.right)

        def apply(values: Mapping[str, object]) -> Result:
            result = compute(_number(left(values)), _number(right(values)))
            if isinstance(result, complex):
                raise TypeError("a root of a negative number")
            return result

        return apply

    def _boolean(self, node: ast.BoolOp) -> Evaluate:
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

    def _comparison(self, node: ast.Compare) -> Evaluate:
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

    def _call(self, node: ast.Call) -> Evaluate:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in _FUNCTIONS:
            raise self._fail(node.func, "the functions are " + ", ".join(sorted(_FUNCTIONS)))
        if node.keywords or (len(node.args) < 2 if name in _VARIADIC else len(node.args) != 1):
            takes = "two or more numbers" if name in _VARIADIC else "one number"
            raise self._fail(node, f"{name} takes {takes}")
        function, terms = _FUNCTIONS[name], [self._term(part) for part in node.args]

        def apply(values: Mapping[str, object]) -> Result:
            try:
                return function(*[_number(term(values)) for term in terms])
            except ValueError as error:
                if isinstance(error, ExpressionError):
                    raise
                raise ArithmeticError(f"{name} is not defined there") from error

        return apply


def _number(value: object) -> float:
    if isinstance(value, int | float):
        return float(value)
    raise TypeError(f"{value!r} is not a number")


def _reason(error: Exception) -> str:
    if isinstance(error, ZeroDivisionError):
        return "division by zero"
    return "a number grows too large" if isinstance(error, OverflowError) else str(error)
