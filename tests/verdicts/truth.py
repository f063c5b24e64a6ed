"""What is true of a motion, as an expression: contactlab's own, over the arrays of a `Motion`.

Rows are times. Beside numbers and arithmetic it may hold

- `time qpos qvel xpos length vertex energy pressed`, as `Motion` has them, and `joint("hinge")`,
  `speed("hinge")`, `body("ball")`, `gap("tip", "eye")`;
- parts of them, as in NumPy: `body("ball")[:, 2]`, `qpos[-1, ::7]`, and the rows `late` (the last
  quarter), `early` (the first) and `settled` (all but the first); `(0, 0, 0.5)` is a row;
- elementwise: `abs sqrt exp log sin cos tan acos atan2 radians degrees`, comparisons, and `max` and
  `min` of several;
- reductions of one array to a number, `max min mean span rms`, and to a row each, `highest lowest`
  (of all the rest) and `norm` (of the last axis);
- `held(condition)`: 1 until it first fails, then 0;
- `finer(place, 8)`, the same by steps an eighth as long, and `awake(place)`, without sleep;
- measures: `restless`, the rms of all speeds at the end; `trembles(2.0, "hip", "knee")`, by how
  much the worst joint's speed alternates from step to step at the end, relative to a speed, and
  `alternation(array)` of any; `beyond("hip", low, high)`, how far a joint, or any array, leaves a
  range, relative to its width; `strays(place, size, 8)`, how far it is from that of finer steps (16
  times, unless told otherwise), relative to a size, and `departs(array, law)`, how far from a law;
- of heights and sites [m]: `below("box", level)`, how far it falls below a level, `under` the same
  and `past` the opposite, both relative to a third number, a size; `rests_off("box", level)`, how
  far from a level it is at the end, `ends_off(array, end, size)` the same of any array, in sizes,
  and `opened("tip", "eye")`, the largest distance of two sites at the end;
- of energy, relative to a scale [J]: `gained(scale)`, and `unbalanced(scale)`, by which loss counts
  as well.
"""

import ast
import inspect
from collections.abc import Callable, Collection
from functools import reduce
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np
from tests.verdicts.motion import Motion, awake, finer

from contactlab.expression import CheckedText, Checker, ExpressionError, call

Place = Callable[[Motion], np.ndarray]


def _late(motion: Motion) -> slice:
    return slice(3 * len(motion.time) // 4, None)


def _rms(array: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(array))))


def _alternation(array: np.ndarray) -> float:
    """Return the rms amplitude of what changes its sign from row to row."""
    return _rms(np.diff(array, 2, axis=0)) / 4


def _excess(array: np.ndarray) -> float:
    return max(float(array.max()), 0.0)


def _beyond(motion: Motion, place: str | np.ndarray, low: float, high: float) -> float:
    array = motion.joint(place) if isinstance(place, str) else place
    return _excess(np.maximum(array - high, low - array)) / (high - low)


def _strays(motion: Motion, place: Place, size: float, factor: float = 16) -> float:
    return float(np.abs(place(motion) - place(finer(motion, round(factor)))).max() / size)


def _trembles(motion: Motion, speed: float, joint: str, *joints: str) -> float:
    late = _late(motion)
    return max(_alternation(motion.speed(name)[late]) for name in (joint, *joints)) / speed


def _of_one(function: Callable[[np.ndarray], np.ndarray]) -> Callable[..., np.ndarray]:
    """Return a function of one argument; many of NumPy take more, or do not say how many."""

    def of_one(array: np.ndarray) -> np.ndarray:
        return function(array)

    return of_one


def _over_rows(reduction: Callable[..., np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    return lambda array: reduction(array, axis=tuple(range(1, array.ndim)))


def _several(
    one: Callable[[np.ndarray], np.ndarray], two: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Callable[..., np.ndarray]:
    return lambda array, *others: reduce(two, others, array) if others else one(array)


_ROWS: dict[str, Callable[[Motion], slice]] = {
    "late": _late,
    "early": lambda motion: slice(None, len(motion.time) // 4),
    "settled": lambda motion: slice(len(motion.time) // 4, None),
}
_ARRAYS = ("time", "qpos", "qvel", "xpos", "length", "vertex", "energy", "pressed")
_NAMES: dict[str, Callable[[Motion], object]] = {
    **{name: attrgetter(name) for name in _ARRAYS},
    **_ROWS,
    "restless": lambda motion: _rms(motion.qvel[_late(motion)]),
}
# The motion comes before the arguments of these.
_OF_MOTION: dict[str, Callable[..., Any]] = {
    **{name: getattr(Motion, name) for name in ("joint", "speed", "body", "gap")},
    "awake": lambda motion, place: place(awake(motion)),
    "below": lambda motion, body, level: _excess(level - motion.body(body)[:, 2]),
    "beyond": _beyond,
    "ends_off": lambda motion, array, end, size: np.abs(array[_late(motion)] - end).max() / size,
    "finer": lambda motion, place, factor: place(finer(motion, round(factor))),
    "gained": lambda motion, scale: (motion.energy.max() - motion.energy[0]) / scale,
    "opened": lambda motion, first, second: motion.gap(first, second)[_late(motion)].max(),
    "past": lambda motion, body, level, size: _excess(motion.body(body)[:, 2] - level) / size,
    "rests_off": lambda motion, body, level: np.abs(
        motion.body(body)[_late(motion), 2] - level
    ).max(),
    "strays": _strays,
    "trembles": _trembles,
    "unbalanced": lambda motion, scale: np.abs(motion.energy - motion.energy[0]).max() / scale,
    "under": lambda motion, body, level, size: _excess(level - motion.body(body)[:, 2]) / size,
}
# Their first argument is evaluated on another motion, and so is handed to them as a function.
_ELSEWHERE = ("finer", "awake", "strays")
_FUNCTIONS: dict[str, Callable[..., Any]] = _OF_MOTION | {
    **{name: _of_one(getattr(np, name)) for name in ("abs", "sqrt", "exp", "log", "mean")},
    **{name: _of_one(getattr(np, name)) for name in ("sin", "cos", "tan", "radians", "degrees")},
    "acos": _of_one(np.arccos),
    "alternation": _alternation,
    "atan2": lambda y, x: np.arctan2(y, x),  # noqa: PLW0108 NumPy's does not say that it takes 2.
    "departs": lambda array, law: np.abs(array - law).max(),
    "held": _of_one(np.cumprod),
    "highest": _over_rows(np.max),
    "lowest": _over_rows(np.min),
    "max": _several(np.max, np.maximum),
    "min": _several(np.min, np.minimum),
    "norm": lambda array: np.linalg.norm(array, axis=-1),
    "rms": _rms,
    "span": _of_one(np.ptp),
}
# Nobody writes these: they stand for names, words, powers and tuples.
_IMPLIED: dict[str, Callable[..., Any]] = {
    "power": lambda base, exponent: base**exponent,
    "read": lambda motion, name: _NAMES[name](motion),
    "row": lambda *numbers: np.array(numbers),
    "word": lambda text: text,
}


class _Checker(Checker):
    """Lets parts of arrays through, and the functions of a truth; refuses other names."""

    functions: ClassVar[Collection[str]] = tuple(_FUNCTIONS)

    def visit_Name(self, node: ast.Name | ast.Attribute) -> ast.expr:  # noqa: N802
        name = self._dotted_name(node)
        if name not in {*_NAMES, *_FUNCTIONS, "pi"}:
            raise self._make_error(node, f"'{name}' is none of {', '.join(_NAMES)}")
        return _with_motion(super().visit_Name(node))

    def visit_Call(self, node: ast.Call) -> ast.expr:  # noqa: N802
        checked = super().visit_Call(node)
        assert isinstance(checked, ast.Call)
        assert isinstance(checked.func, ast.Name)
        if checked.func.id in _ELSEWHERE:
            of_motion = ast.arguments([], [ast.arg("motion")], None, [], [], None, [])
            checked.args[0] = ast.Lambda(of_motion, checked.args[0])
        return _with_motion(checked) if checked.func.id in _OF_MOTION else checked

    def visit_Tuple(self, node: ast.Tuple) -> ast.expr:  # noqa: N802
        return call("row", *[self.visit(number) for number in node.elts])

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:  # noqa: N802
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        index = ast.Tuple([self._part(part) for part in parts], ast.Load())
        return ast.Subscript(self.visit(node.value), index, ast.Load())

    def _part(self, node: ast.expr) -> ast.expr:
        """Return a part of an index: rows with a name, a whole number, or a range of them."""
        if isinstance(node, ast.Name) and node.id in _ROWS:
            return _with_motion(call("read", ast.Constant(node.id)))
        bounds = [node.lower, node.upper, node.step] if isinstance(node, ast.Slice) else [node]
        if not all(bound is None or _is_whole(bound) for bound in bounds):
            raise self._make_error(
                node, f"an index has whole numbers, ranges and {', '.join(_ROWS)}"
            )
        return node

    def _accepts_count(self, name: str, count: int) -> bool:
        try:
            inspect.signature(_FUNCTIONS[name]).bind(*range(count + (name in _OF_MOTION)))
        except TypeError:
            return False
        return True

    def _describe_arguments(self, name: str) -> str:
        parameters = list(inspect.signature(_FUNCTIONS[name]).parameters.values())
        named = [str(parameter.replace(annotation=parameter.empty)) for parameter in parameters]
        return ", ".join(named[name in _OF_MOTION :])


def _with_motion(node: ast.expr) -> ast.expr:
    """Hand the motion to a call, before its other arguments; a number stays as it is."""
    if isinstance(node, ast.Call):
        node.args.insert(0, ast.Name("motion", ast.Load()))
    return node


def _is_whole(node: ast.expr) -> bool:
    operand = node.operand if isinstance(node, ast.UnaryOp) else node
    signed = not isinstance(node, ast.UnaryOp) or isinstance(node.op, ast.USub)
    return signed and isinstance(operand, ast.Constant) and type(operand.value) is int


class Truth(CheckedText):
    """An expression that is measured of a motion."""

    def _make_checker(self, text: str) -> Checker:
        return _Checker(text, self.places)

    def measure(self, motion: Motion) -> float:
        """Return its number; an ExpressionError if it is none, or the model lacks what it names."""
        called = {"__builtins__": {}, **_FUNCTIONS, **_IMPLIED, "motion": motion}
        try:
            with np.errstate(all="ignore"):
                result = eval(self._code, called)  # noqa: S307 All that it can call is in there.
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            raise ExpressionError(str(error.args[0]), 0, len(self.text)) from error
        if np.ndim(result):
            message = f"an array of shape {np.shape(result)}, not a number: take its max"
            raise ExpressionError(message, 0, len(self.text))
        if not isinstance(result, float | int | np.number | np.bool_):
            raise ExpressionError("neither an array nor a number", 0, len(self.text))
        return float(result) if np.isfinite(result) else np.inf
