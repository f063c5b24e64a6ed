"""Expressions over the fields of mjModel and mjData, for predicates and measures of advisories.

Names are those of MuJoCo: sizes (nv), options (timestep, solver), flags (multiccd), and fields of
mjModel and mjData (geom_type, qacc, contact.dist). A field is an array with one entry for each
object, so `geom_margin > 0` is one truth value for each geom; any(...), count(...) and
largest(...) make one value of it. An index picks the row of a named object, a column, or rows by
their ids: qacc['hinge'], xpos['ball', 2], geom_size[0], body_mass[geom_bodyid]. Kinds are words:
geom_type == 'mesh'.
"""

import ast
import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from typing import Any, ClassVar

import mujoco
import numpy as np

from contactlab.expression import CheckedText, Checker, ExpressionError, NoValueError, call
from contactlab.mjcf import OPTIONS
from contactlab.numerical_tolerance import ROUNDING
from contactlab.scene.compile_model import SENSOR_PREFIX
from contactlab.scene.contact_pairs import touch_places
from contactlab.scene.equation_error import measure_equation_error
from contactlab.scene.model_edits import FLAG_NAMES, read_flag, read_option
from contactlab.scene.model_xml import Elements
from contactlab.scene.mujoco_versions import enum_members, missing_flags

_SPARSE_FROM = 60
"""Least degrees of freedom of a sparse jacobian="auto", as the XML reference says."""
_ENUMS = {
    "geom_type": ("mjtGeom", "mjGEOM_"),
    "jnt_type": ("mjtJoint", "mjJNT_"),
    "eq_type": ("mjtEq", "mjEQ_"),
    "sensor_type": ("mjtSensor", "mjSENS_"),
    "sensor_objtype": ("mjtObj", "mjOBJ_"),
    "wrap_type": ("mjtWrap", "mjWRAP_"),
    "actuator_trntype": ("mjtTrn", "mjTRN_"),
    "actuator_dyntype": ("mjtDyn", "mjDYN_"),
    "actuator_gaintype": ("mjtGain", "mjGAIN_"),
    "actuator_biastype": ("mjtBias", "mjBIAS_"),
}
"""Fields with numbers that are read as words, and the enum of these words."""
_OBJECTS = {
    "body": ("body_", "xpos", "xquat", "xmat", "xipos", "cvel", "cacc", "cfrc", "subtree", "xfrc"),
    "geom": ("geom_",),
    "site": ("site_",),
    "mesh": ("mesh_",),
    "pair": ("pair_",),
    "equality": ("eq_",),
    "tendon": ("tendon_", "ten_"),
    "actuator": ("actuator_", "ctrl"),
    "jnt": ("jnt_",),
    "qpos": ("qpos",),
    "dof": ("dof_", "qvel", "qacc", "qfrc", "cdof"),
    "sensor": ("sensordata", "sensor_"),
}
"""Kinds of named rows, with the beginnings of the names of their fields."""
_FIRST_ROWS = {"qpos": "jnt_qposadr", "dof": "jnt_dofadr"}
"""Fields with the first row of each joint."""


@dataclass(frozen=True)
class ModelFacts:
    """A compiled model and, for measures, a state of it.

    Attributes:
        model: the compiled model.
        data: the state after a forward computation; None for facts of the model alone.
        list_elements: returns those of the model's files, each with its path, such as
            mujoco/default/geom, and its attributes; None if the files are unknown.
    """

    model: mujoco.MjModel
    data: mujoco.MjData | None = None
    list_elements: Callable[[], Elements] | None = None

    def read_value(self, name: str) -> Any:  # noqa: ANN401 - a number, word or array
        """Return the value of a name; NoValueError if this MuJoCo does not have it."""
        model = self.model
        if name in _DERIVED:
            return _DERIVED[name](self)
        if name in OPTIONS:
            return read_option(model, name) if hasattr(model.opt, name) else self._refuse_name(name)
        if name in FLAG_NAMES or name in missing_flags():
            return read_flag(model, name)
        value: Any = None
        for owner in (model, self.data):
            value = reduce(lambda part, word: getattr(part, word, None), name.split("."), owner)
            if value is not None:
                break
        if name.startswith("sensor_") and isinstance(value, np.ndarray):
            value = value[self._is_own_sensor]
        if name in _ENUMS and value is not None:
            words = _words_of(*_ENUMS[name])
            return np.array([words.get(int(number), "") for number in value], dtype=str)
        if name.startswith("_") or not isinstance(value, int | float | np.ndarray):
            return self._refuse_name(name)
        return np.asarray(value) if isinstance(value, np.ndarray) else value

    @cached_property
    def _is_own_sensor(self) -> np.ndarray:
        # Others are added to record runs, after those of the model's files.
        names = (self.model.sensor(place).name for place in range(self.model.nsensor))
        return np.array([not name.startswith(SENSOR_PREFIX) for name in names], bool)

    def read_row(self, name: str, *index: str | float) -> Any:  # noqa: ANN401 - a number or array
        """Return the row of a named object, one number of it, or a column of all rows."""
        array = np.asarray(self.read_value(name))
        first = index[0]
        try:
            if not isinstance(first, str):
                return array[int(first)] if array.ndim == 1 else array[:, int(first)]
            row = self._row_of(name, first)
            column = int(index[1]) if len(index) > 1 else None
            if array.ndim == 1:
                return array[row + (column or 0)]
            return array[row] if column is None else array[row, column]
        except IndexError as error:
            raise ExpressionError(
                f"{name} has the shape {array.shape}; use a smaller index"
            ) from error

    def count_elements(self, path: str, attribute: str, value: str | None = None) -> int:
        """Return how many elements with an attribute have a path that ends like this one.

        With a value, only those count that have it.
        """
        if self.list_elements is None:
            raise NoValueError("elements() needs the files of the model")
        return sum(
            f"/{place}".endswith(f"/{path}")
            and attribute in values
            and value in (None, values[attribute])
            for place, values in self.list_elements()
        )

    def count_pairs(self, first: Any, second: Any) -> int:  # noqa: ANN401 - truth values of geoms
        """Return how many pairs that may collide have one of the first geoms, and a second one."""
        if isinstance(first, str) or isinstance(second, str):
            raise ExpressionError(
                "pairs() takes truth values of geoms: pairs(geom_type == 'box', geom_condim > 1)"
            )
        if not (np.any(first) and np.any(second)):
            return 0
        first, second = (np.broadcast_to(each, self.model.ngeom) for each in (first, second))
        one, other = touch_places(self.model)
        chosen = (first[one] & second[other]) | (first[other] & second[one])
        return int(np.count_nonzero(chosen))

    def count_contacts(self, first: str, second: str) -> int:
        """Return the number of contacts of two geoms that touch or overlap."""
        return len(self._list_distances(first, second))

    def find_depth(self, first: str, second: str) -> float:
        """Return the depth of the deepest contact of two geoms [m]; 0 without contacts."""
        return -min(self._list_distances(first, second), default=0.0)

    def find_distance(self, first: str, second: str) -> float:
        """Return the distance of two geoms by mj_geomDistance, at most 10 m [m]."""
        one, other = (self._row_of("geom_", name) for name in (first, second))
        assert self.data is not None
        return float(mujoco.mj_geomDistance(self.model, self.data, one, other, 10.0, None))

    def _list_distances(self, first: str, second: str) -> list[float]:
        ids = sorted(self._row_of("geom_", name) for name in (first, second))
        assert self.data is not None
        contacts = self.data.contact
        same = (np.sort(contacts.geom, axis=1) == ids).all(axis=1)
        return [float(distance) for distance in contacts.dist[same] if distance <= 0]

    def _row_of(self, field: str, name: str) -> int:
        kinds = [kind for kind, starts in _OBJECTS.items() if field.startswith(starts)]
        kind = kinds[0] if kinds else self._refuse_name(f"{field}['{name}']")
        model = self.model
        word = {"jnt": "joint", "qpos": "joint", "dof": "joint"}.get(kind, kind)
        row = mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{word.upper()}"), name)
        if row < 0:
            raise ExpressionError(f"no {word} '{name}' in the model")
        if field == "sensordata":
            return int(model.sensor_adr[row])
        return int(getattr(model, _FIRST_ROWS[kind])[row]) if kind in _FIRST_ROWS else row

    def _refuse_name(self, name: str) -> Any:  # noqa: ANN401 - never returns
        raise NoValueError(f"'{name}' is not a field of mjModel or mjData of this MuJoCo")


@cache
def _words_of(enum: str, prefix: str) -> dict[int, str]:
    members = enum_members(getattr(mujoco, enum), prefix)
    return {number: name.lower() for name, number in members.items()}


def _has_sparse_jacobian(facts: ModelFacts) -> bool:
    word = read_option(facts.model, "jacobian")
    return word == "sparse" or (word == "auto" and facts.model.nv >= _SPARSE_FROM)


def _has_branches(facts: ModelFacts) -> bool:
    parents = facts.model.dof_parentid[facts.model.dof_parentid >= 0]
    return bool((np.bincount(parents, minlength=1) > 1).any())


def _has_singular_inertia(facts: ModelFacts) -> bool:
    model = facts.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    inertia = np.zeros((model.nv, model.nv))
    for row, unit in zip(inertia, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, row, unit)
    values = np.linalg.eigvalsh(inertia) if model.nv else np.ones(1)
    return bool(values[0] <= ROUNDING * values[-1])


def _find_equation_error(facts: ModelFacts) -> float:
    if facts.data is None:
        raise NoValueError("equation_error needs a state; use it in occurs or in measure")
    return measure_equation_error(facts.model, facts.data)


_DERIVED: Mapping[str, Callable[[ModelFacts], object]] = {
    "sparse_jacobian": _has_sparse_jacobian,
    "branching_trees": _has_branches,
    "singular_inertia": _has_singular_inertia,
    "equation_error": _find_equation_error,
}
"""Facts without a field of their own."""


class FieldExpression(CheckedText):
    """An expression over the fields of a model and a state."""

    def _make_checker(self, text: str) -> Checker:
        return _FieldChecker(text, self.places)

    def evaluate_facts(self, facts: ModelFacts) -> float:
        """Return the value, which may be infinite or none; truth values are 1 and 0.

        Raises:
            NoValueError: this MuJoCo lacks a field.
            ExpressionError: there is no such object, or the result is an array.
        """
        functions = {
            **_FUNCTIONS,
            **{word: getattr(facts, name) for word, name in _METHODS.items()},
        }
        try:
            with np.errstate(all="ignore"):
                result = eval(self._code, {"__builtins__": {}, **functions})  # noqa: S307 - a checked tree
        except (ArithmeticError, TypeError, ValueError) as error:
            if isinstance(error, ExpressionError):
                raise
            raise ExpressionError(f"{self.text}: {error}") from error
        if np.size(result) != 1 or isinstance(result, str):
            raise ExpressionError(f"{self.text}: not a single number; use any, count or largest")
        return float(np.asarray(result).reshape(()))


def _combine_all(*parts: Any) -> Any:  # noqa: ANN401 - truth values or arrays of them
    return reduce(np.logical_and, parts)


def _combine_any(*parts: Any) -> Any:  # noqa: ANN401 - truth values or arrays of them
    return reduce(np.logical_or, parts)


def _pick_rows(values: Any, ids: Any) -> Any:  # noqa: ANN401 - arrays
    array = np.asarray(values)
    # An id of another kind of object may be out of range: any row does, as its kind is wrong.
    if not len(array):
        return np.zeros(len(ids), array.dtype)
    return np.take(array, ids, axis=0, mode="clip")


def _find_largest(values: Any) -> float:  # noqa: ANN401 - a number or an array
    return float(np.max(np.asarray(values, float), initial=-np.inf))


def _find_smallest(values: Any) -> float:  # noqa: ANN401 - a number or an array
    return float(np.min(np.asarray(values, float), initial=np.inf))


_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "any": np.any,
    "count": np.count_nonzero,
    "largest": _find_largest,
    "smallest": _find_smallest,
    "sum": np.sum,
    "norm": lambda values: float(np.linalg.norm(np.ravel(values))),
    "power": operator.pow,
    "pick": _pick_rows,
    "all_of": _combine_all,
    "one_of": _combine_any,
    "inverted": np.logical_not,
}
_METHODS = {
    "read": "read_value",
    "row": "read_row",
    "elements": "count_elements",
    "pairs": "count_pairs",
    "contacts": "count_contacts",
    "depth": "find_depth",
    "distance": "find_distance",
}
_OF_TWO = {"elements", "pairs", "contacts", "depth", "distance"}
_INNER = {"power", "pick", "all_of", "one_of", "inverted", "read", "row"}


class _FieldChecker(Checker, ast.NodeTransformer):
    """Refuses unlisted syntax, and replaces names, indices and logic by calls."""

    functions: ClassVar[Collection[str]] = tuple(
        name for name in (*_FUNCTIONS, *_METHODS) if name not in _INNER
    )

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        """Return a word unchanged, and numbers as usual."""
        return node if isinstance(node.value, str) else super().visit_Constant(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.expr:
        """Return the call that combines truth values entry by entry."""
        parts = [self.visit(part) for part in node.values]
        return call("all_of" if isinstance(node.op, ast.And) else "one_of", *parts)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """Return `not` as a call that works entry by entry."""
        inverts = isinstance(node.op, ast.Not)
        return call("inverted", self.visit(node.operand)) if inverts else self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Return a comparison of two values."""
        if len(node.ops) > 1:
            raise self._make_error(node, "write a < b and b < c, instead of a < b < c")
        return self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        """Return the call that reads a row, a column, or rows by ids."""
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if not all(isinstance(part, ast.Constant) for part in parts):
            return call("pick", self.visit(node.value), self.visit(node.slice))
        kinds = [type(part.value) for part in parts if isinstance(part, ast.Constant)]
        if kinds not in ([str], [int], [str, int]):
            raise self._make_error(node, "write field['name'], field['name', 2] or field[2]")
        name = self._dotted_name(node.value)
        self._places.setdefault(name, self._node_span(node)[0])
        return call("row", ast.Constant(name), *parts)

    def _accepts_count(self, name: str, count: int) -> bool:
        return count == (2 if name in _OF_TWO else 1) or (name == "elements" and count == 3)

    def _describe_arguments(self, name: str) -> str:
        return "two arguments" if name in _OF_TWO else "one argument"
