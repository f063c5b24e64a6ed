"""Expressions equal Python's own arithmetic, and nothing else gets in."""

import ast
import math
import pickle
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.expression import Expression, ExpressionError

VALUES = {"a": 0.5, "b": -2.0, "solref.timeconst": 3.0}
PYTHON_NAMES = {"a": 0.5, "b": -2.0, "solref": type("", (), {"timeconst": 3.0})}
FUNCTIONS: dict[str, Any] = {
    "abs": abs,
    "min": min,
    "max": max,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "exp": math.exp,
    "log": math.log,
    "radians": math.radians,
    "degrees": math.degrees,
    "pi": math.pi,
}

ATOMS = st.sampled_from([*VALUES, "pi", "1.0", "2.5", "1e-3", "0.0"])


def joined(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    operators = ["+", "-", "*", "/", "**", "<", "<=", ">", ">=", "==", "!=", "and", "or"]
    one = sorted(set(FUNCTIONS) - {"pi", "min", "max"})
    return st.one_of(
        st.tuples(parts, st.sampled_from(operators), parts).map(lambda t: f"({' '.join(t)})"),
        st.tuples(st.sampled_from(["-", "+", "not "]), parts).map(lambda t: f"({t[0]}{t[1]})"),
        st.tuples(st.sampled_from(one), parts).map(lambda t: f"{t[0]}({t[1]})"),
        st.tuples(st.sampled_from(["min", "max"]), parts, parts).map(
            lambda t: f"{t[0]}({t[1]}, {t[2]})"
        ),
        st.tuples(parts, parts, parts).map(lambda t: f"({t[0]} < {t[1]} <= {t[2]})"),
    )


class RealPowers(ast.NodeTransformer):
    """Makes powers calls of `pow`, so that one that is complex can be refused where it arises."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Pow):
            return node
        return ast.Call(ast.Name("pow", ast.Load()), [node.left, node.right], [])


def real_power(base: float, exponent: float) -> float:
    """Return a power; raises where Python's is complex."""
    result = base**exponent
    if isinstance(result, complex):
        raise ArithmeticError
    return result


def by_python(text: str) -> object:
    """Return Python's result, or None where it, or a part of it, is not a finite real number."""
    tree = ast.fix_missing_locations(RealPowers().visit(ast.parse(text, mode="eval")))
    names = {"__builtins__": {}, "pow": real_power, **FUNCTIONS}
    try:
        result = eval(compile(tree, "expression", "eval"), names, PYTHON_NAMES)  # noqa: S307
    except (ArithmeticError, ValueError, TypeError):
        return None
    return result if isinstance(result, bool | int | float) and math.isfinite(result) else None


@given(st.recursive(ATOMS, joined, max_leaves=12))
def test_equals_python(text: str) -> None:
    expected = by_python(text)
    try:
        result = Expression(text).evaluate(VALUES)
    except ExpressionError:
        result = None
    assert result == expected


@pytest.mark.parametrize("text", ["9**9**9", "2**9999", "-9**9**9", "exp(9**9)", "1e308 * 10"])
def test_does_not_run_away(text: str) -> None:
    with pytest.raises(ExpressionError, match=r"large|finite"):
        Expression(text).evaluate({})


@pytest.mark.parametrize(
    ("text", "start", "width"),
    [
        ("a + open('x')", 4, 4),
        ("a.b.__class__()", 0, 13),
        ("(1).real", 1, 1),
        ("[1, 2]", 0, 6),
        ("a if b else c", 0, 13),
        ("lambda: 1", 0, 9),
        ("  a % 2", 2, 5),
        ("a < sqrt", 4, 4),
        ("min(a)", 0, 6),
        ("sqrt(a, b)", 0, 10),
        ("1j + a", 0, 2),
        ("a is b", 0, 6),
        ("f'{a}'", 0, 6),
        ("é + max(1)", 4, 6),
        ("1 + * 2", 4, 1),
        ("  1 + )", 6, 1),
    ],
)
def test_refuses_all_else_and_says_where(text: str, start: int, width: int) -> None:
    with pytest.raises(ExpressionError) as caught:
        Expression(text)
    assert (caught.value.start, caught.value.width) == (start, width)


@pytest.mark.parametrize("text", ["", "a +", "((a)", "a b", "a\x00b", "a; b", "a = 1"])
def test_refuses_what_is_no_expression(text: str) -> None:
    with pytest.raises(ExpressionError, match="not an expression"):
        Expression(text)


@pytest.mark.parametrize("text", ["(" * 150 + "a" + ")" * 150 + "+" * 800, "-" * 999 + "1"])
def test_deep_nesting_is_refused_not_fatal(text: str) -> None:
    with pytest.raises(ExpressionError):
        Expression(text)


def test_names_are_the_ones_it_reads() -> None:
    expression = Expression("solref.timeconst < 2*timestep and cone == 'elliptic' or pi > 3")
    assert expression.names == ("solref.timeconst", "timestep", "cone")
    assert expression.places == {"solref.timeconst": 0, "timestep": 21, "cone": 34}


def test_words_compare_but_do_not_count() -> None:
    assert Expression("cone == 'elliptic'").evaluate({"cone": "elliptic"}) is True
    assert Expression("multiccd").evaluate({"multiccd": True}) is True
    for text in ("'a' * 3", "'a' < 'b'", "-cone", "abs(cone)"):
        with pytest.raises(ExpressionError, match="not a number"):
            Expression(text).evaluate({"cone": "elliptic"})


def test_a_pair_is_not_one_number() -> None:
    with pytest.raises(ExpressionError, match="'solref' is not a single number"):
        Expression("solref > 1").evaluate({"solref": (0.02, 1.0)})


def test_a_missing_value_is_named() -> None:
    with pytest.raises(ExpressionError, match="'height' has no value"):
        Expression("2 * height").evaluate({})


def test_an_expression_travels_between_processes() -> None:
    there = pickle.loads(pickle.dumps(Expression("a.b > 2 and c")))  # noqa: S301 - our own
    assert there.names == ("a.b", "c")
    assert there.evaluate({"a.b": 3.0, "c": 1.0})
