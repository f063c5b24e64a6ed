"""The canonical values of a sweep's axes: lists, forms, zip blocks and samples.

Values of `linspace` and `range` are computed exactly and rounded once: the third step of 0.1 is
0.3. Others are rounded to 12 digits, so that they do not depend on the machine's math library, and
runs of two machines can be paired.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cached_property
from typing import cast

import numpy as np
from pydantic import ValidationError

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import did_you_mean
from contactlab.plan.diagnostics import Place
from contactlab.plan.grid import Block
from contactlab.plan.validation import Draft
from contactlab.plan.yaml_document import Document, KeyPath
from contactlab.schema.setting_values import SI_UNITS, split_unit, without_unit
from contactlab.schema.sweep_schema import Sample
from contactlab.schema.vocabulary import (
    FORMS,
    Axis,
    AxisSpec,
    Drawn,
    Linspace,
    Logspace,
    Range,
    Ranged,
    Sampled,
    Uniform,
    Values,
    Vocabulary,
)

# Number of amounts at the start of each form.
_AMOUNT_COUNTS = {"linspace": 2, "logspace": 2, "range": 3, "uniform": 2, "loguniform": 2}
_UNIT_RANGE = re.compile(r"([-+.\de]+?)\.\.([-+.\de]+)\s*([^-+.\d\s]\S*)")


UNREADABLE = object()


@dataclass(frozen=True)
class SweepContext(Draft):
    """A draft, and the names of its scene."""

    vocabulary: Vocabulary

    def find_axis(self, name: str) -> AxisSpec | None:
        """Return the axis of this name, or None."""
        return self.vocabulary.find(name)

    def canonical_value(self, name: str, value: object, place: Place) -> object:
        """Return the canonical form of a value. Otherwise return UNREADABLE and add the mistake."""
        spec = self.find_axis(name)
        if spec is None:
            return UNREADABLE
        with suppress(ValueError):  # a word that is not a number may still be a value
            if isinstance(value, float | str) and not math.isfinite(float(value)):
                hint = "write a finite number"
                self.document.add_mistake("not-finite", place, f"'{name}' must be finite", hint)
                return UNREADABLE
        magnitude = without_unit(value, spec.unit)
        try:
            return spec.parse(value if magnitude is None else magnitude)
        except ValueError as error:
            close = did_you_mean(value, spec.choices) if isinstance(value, str) else ""
            plain_value = list(cast("tuple[object]", value)) if isinstance(value, tuple) else value
            message = f"{plain_value!r} is not a value of '{name}'"
            # A number with the unit of another quantity, or with an unknown one.
            takes_one = bool(spec.unit) and " " not in spec.unit
            other = takes_one and magnitude is None and str(value)[:1].isdigit()
            hint = (
                f"write a number{f' in {spec.unit}' * (spec.unit != '1')}"
                if other and not isinstance(value, float | int)
                else str(error)
            )
            self.document.add_mistake("bad-value", place, message, f"{hint}{close}")
            return UNREADABLE

    @cached_property
    def swept(self) -> list[tuple[str, KeyPath]]:
        """The axes in the file, readable or not, with their paths."""
        paths: list[KeyPath] = [("axes", name) for name in self.document.mapping_at("axes")]
        for index, block in zip_blocks(self.document):
            paths.extend(("zip", index, name) for name in block)
        return [(str(path[-1]), path) for path in paths]


def zip_blocks(document: Document) -> Iterator[tuple[int, dict[str, object]]]:
    """Yield the blocks of `zip` that are mappings, readable or not, with their positions."""
    blocks = document.value_at(("zip",))
    for index in range(len(cast("list[object]", blocks)) if isinstance(blocks, list) else 0):
        yield index, document.mapping_at("zip", index)


def listed_values(axis: Axis, all_values: Sequence[object] = ()) -> Sequence[object]:
    """Return the values of an axis that is not sampled, in order, not yet canonical.

    `all_values` are those of the axis, if they are few.
    """
    match axis:
        case "all" | Drawn():
            count, seed = (len(all_values), 0) if axis == "all" else (axis.sample, axis.seed)
            places = np.random.default_rng(seed).permutation(len(all_values))[:count]
            return [all_values[place] for place in sorted(places.tolist())]
        case Linspace(linspace=(first, last, count)):
            start, stride = (
                _exact_decimal(first),
                (_exact_decimal(last) - _exact_decimal(first)) / (count - 1),
            )
            return [_plain_number(start + stride * k) for k in range(count)]
        case Logspace(logspace=(first, last, count)):
            steps, low, high = count - 1, math.log(first), math.log(last)
            inner = [
                _round_digits(math.exp(low + (high - low) * k / steps)) for k in range(1, steps)
            ]
            return [_plain_number(_exact_decimal(value)) for value in (first, *inner, last)]
        case Range(range=(first, last, step)):
            start, end, stride = _exact_decimal(first), _exact_decimal(last), _exact_decimal(step)
            return [_plain_number(start + k * stride) for k in range((end - start) // stride + 1)]
        case Values(values=values):
            return values
        case tuple():
            return axis
        case _:
            raise TypeError(f"{type(axis).__name__} is sampled")


def write_out_units(
    document: Document, unit_of: Callable[[str], str], bound_in: Callable[[str], str]
) -> None:
    """Write out the values of axes in units: `1..5 N`, and forms such as {linspace: [1 N, 5 N, 5]}.

    Bounds of sampled axes are converted to the unit of their axis, and bounds of metrics and
    thresholds to theirs. All other entries stay unchanged; later checks report their mistakes.
    """
    expected = document.value_at(("expect",))
    entries = cast("list[object]", expected) if isinstance(expected, list) else []
    places = [("expect", index) for index in range(len(entries))]
    bounds = [document.mapping_at(*at, key) for at in places for key in ("metrics", "mean")]
    for block in (document.mapping_at("tolerances"), document.mapping_at("thresholds"), *bounds):
        for name, data in block.items():
            inner = cast("dict[str, object]", data) if isinstance(data, dict) else {}
            for key, bound in inner.items():
                inner[key] = _bound_in_unit(bound, bound_in, name)
            block[name] = _bound_in_unit(data, bound_in, name)
    blocks = [document.mapping_at("axes"), *(block for _, block in zip_blocks(document))]
    for block in blocks:
        for name, data in block.items():
            form = parse_unit_range(data) if isinstance(data, str) else data
            if isinstance(form, dict):
                block[name] = _form_in_unit(cast("dict[str, object]", form), unit_of, name)


def _bound_in_unit(data: object, unit_of: Callable[[str], str], name: str) -> object:
    # A number without a unit, or with a wrong one, stays unchanged.
    if not split_unit(data)[1]:
        return data
    plain = without_unit(data, unit) if (unit := unit_of(name)) in SI_UNITS else None
    return data if plain is None else plain


def parse_unit_range(text: str) -> dict[str, object] | None:
    """Return the form of an axis for a text such as `1..5 N`, in steps of one; or None."""
    if (parts := _UNIT_RANGE.fullmatch(text.strip())) is None:
        return None
    first, last, unit = parts.groups()
    return {"range": [f"{first} {unit}", f"{last} {unit}", f"1 {unit}"]}


def _form_in_unit(
    form: dict[str, object], unit_of: Callable[[str], str], axis: str
) -> dict[str, object]:
    # The values in one unit are listed; a form without one unit stays unchanged.
    name = next((key for key in _AMOUNT_COUNTS if key in form), "")
    parts = form.get(name)
    amounts = cast("list[object]", parts)[: _AMOUNT_COUNTS[name]] if isinstance(parts, list) else []
    units = {split_unit(amount)[1] for amount in amounts}
    kinds = {SI_UNITS.get(unit, ("",))[0] for unit in units}
    if len(kinds) != 1 or "" in kinds:
        return form
    sampled = name in ("uniform", "loguniform")
    unit = unit_of(axis) if sampled else (units if len(units) == 1 else kinds).pop()
    if sampled and SI_UNITS.get(unit, ("",))[0] not in kinds:
        return form
    numbers = [without_unit(amount, unit) for amount in amounts]
    plain = {name: [*numbers, *cast("list[object]", parts)[_AMOUNT_COUNTS[name] :]]}
    if sampled:
        return {**form, **plain}
    try:
        values = listed_values(cast("Axis", FORMS[name].model_validate(plain)))
    except ValidationError:
        return {**form, **plain}
    rest = {key: value for key, value in form.items() if key != name}
    return {"values": [f"{value!r} {unit}" for value in values], **rest}


def sample_points(sample: Sample, dimensions: int) -> Floats:
    """Return (n, dimensions) points in the unit cube [0, 1).

    The points of saltelli are the rows of A, of B, and, for each axis, of A with B's column of that
    axis. A and B are halves of one Sobol sequence (A. Saltelli et al., 2010).
    """
    # The import takes half a second; sweeps without samples avoid it.
    from scipy.stats import qmc  # noqa: PLC0415

    if sample.method == "random":
        return np.random.default_rng(sample.seed).random((sample.n, dimensions))
    if sample.method == "lhs":
        return qmc.LatinHypercube(dimensions, rng=sample.seed).random(sample.n)
    if sample.method == "saltelli":
        both = qmc.Sobol(2 * dimensions, rng=sample.seed).random(sample.n)
        first, second = both[:, :dimensions], both[:, dimensions:]
        mixed = np.repeat(first[None], dimensions, axis=0)
        for axis in range(dimensions):
            mixed[axis, :, axis] = second[:, axis]
        return np.concatenate((first, second, *mixed))
    # The first n points of a Sobol sequence do not depend on the number of draws.
    power = math.ceil(math.log2(sample.n)) if sample.n > 1 else 0
    return qmc.Sobol(dimensions, rng=sample.seed).random_base2(power)[: sample.n]


def sampled_values(axis: Sampled, spec: AxisSpec, units: Floats) -> list[object]:
    """Return values for points in [0, 1); whole numbers if the axis takes no others."""
    low, high = _sampled_bounds(axis)
    whole = low.is_integer() and high.is_integer() and spec.accepts_value(low)
    whole = whole and not spec.accepts_value(low + 0.5)
    stop = high + 1 if whole else high
    if isinstance(axis, Uniform):
        scaled = low + units * (stop - low)
    else:
        scaled = np.exp(math.log(low) + units * (math.log(stop) - math.log(low)))
    rounded = (math.floor(value) if whole else _round_digits(value) for value in scaled.tolist())
    return [min(max(value, low), high) for value in rounded]


def _sampled_bounds(axis: Sampled) -> tuple[float, float]:
    return axis.uniform if isinstance(axis, Uniform) else axis.loguniform


def _exact_decimal(value: float) -> Fraction:
    return Fraction(Decimal(repr(value)))


def _plain_number(value: Fraction) -> float:
    return value.numerator if value.denominator == 1 else float(value)


def _round_digits(value: float) -> float:
    digits = 12
    return float(f"{value:.{digits}g}")


def read_blocks(context: SweepContext) -> tuple[Block, ...] | None:
    """Return the blocks of the product, or None if the file only lists rows to include."""
    sweep = context.sweep
    blocks: list[Block] = []
    sampled: dict[str, Sampled] = {}
    for name, axis in sweep.axes.items():
        if isinstance(axis, Sampled):
            sampled[name] = axis
        else:
            values = _axis_values(context, ("axes", name), axis)
            blocks.append(Block((name,), tuple(zip(values, strict=True))))
    for index, axes in enumerate(sweep.zip):
        blocks.append(_zip_block(context, context.entry_path("zip", index), axes))
    blocks.extend(_sampled_blocks(context, sampled))
    return tuple(blocks) if blocks or not sweep.include else None


def _axis_values(context: SweepContext, path: KeyPath, axis: Axis) -> list[object]:
    name, is_written = str(path[-1]), isinstance(axis, Values | tuple)
    below = (*path, axis.form_key()) if isinstance(axis, Ranged) else path
    all_values = _known_values(context, name)
    least = axis.sample if isinstance(axis, Drawn) else int(axis == "all")
    if context.find_axis(name) and len(all_values) < least:
        message = f"'{name}' has {len(all_values) or 'no'} listed values of its own"
        context.document.add_mistake("bad-value", below, message, "write a list: [...]")
    return _canonical_column(
        context, name, listed_values(axis, all_values), below, is_written=is_written
    )


def _known_values(context: SweepContext, name: str) -> Sequence[object]:
    spec = context.find_axis(name)
    return (spec.accepted_values or spec.choices) if spec else ()


def _canonical_column(
    context: SweepContext, name: str, values: Sequence[object], path: KeyPath, *, is_written: bool
) -> list[object]:
    column: list[object] = []
    for index, value in enumerate(values):
        place = context.document.value_place((*path, index) if is_written else path)
        column.append(context.canonical_value(name, value, place))
        if column[-1] is UNREADABLE and not is_written:
            break
    return column


def _zip_block(context: SweepContext, path: KeyPath, axes: Mapping[str, Axis]) -> Block:
    document = context.document
    columns: dict[str, list[object]] = {}
    counts: dict[str, int] = {}
    for name, axis in axes.items():
        if isinstance(axis, Sampled):
            why = f"'{name}' is sampled, so it cannot advance with others"
            document.add_mistake(
                "sampled-in-zip", document.key_place((*path, name)), why, "move it to `axes`"
            )
            continue
        columns[name] = _axis_values(context, (*path, name), axis)
        counts[name] = len(listed_values(axis, _known_values(context, name)))
        first = next(iter(counts))
        if counts[name] != counts[first]:
            one, other = counts[name], counts[first]
            message = (
                f"'{name}' has {one} value{'' if one == 1 else 's'}, but '{first}' has {other}"
            )
            document.add_mistake("zip-length", (*path, name), message, "give each as many values")
    return Block(tuple(columns), tuple(zip(*columns.values(), strict=False)))


def _sampled_blocks(context: SweepContext, axes: Mapping[str, Sampled]) -> list[Block]:
    document, sample = context.document, context.sweep.sample
    if axes and "sample" not in document.mapping_at():
        name = next(iter(axes))
        message = f"'{name}' is sampled, but there is no `sample`"
        hint = "add sample: {method: sobol, n: 64}"
        document.add_mistake("sample-missing", document.key_place(("axes", name)), message, hint)
    axis_keys = (path[2] for path in document.keys if path[0] == "axes" and len(path) == 3)
    if sample and not {"uniform", "loguniform"}.intersection(axis_keys):
        hint = "give an axis as {uniform: [low, high]} or {loguniform: [low, high]}"
        document.add_mistake(
            "sample-unused", document.key_place(("sample",)), "no axis is sampled", hint
        )
    if sample and sample.method == "saltelli" and sample.n & (sample.n - 1):
        place, near = document.value_place(("sample", "n")), 1 << sample.n.bit_length()
        hint = f"write n: {near // 2}, or {near}"
        document.add_mistake("bad-value", place, "saltelli takes a power of two", hint)
        return []
    if not axes or not sample:
        return []
    cube = sample_points(sample, len(axes))
    columns: list[list[object]] = []
    for index, (name, axis) in enumerate(axes.items()):
        spec, path = context.find_axis(name), ("axes", name, axis.form_key())
        bounds = _canonical_column(context, name, _sampled_bounds(axis), path, is_written=True)
        if spec is not None and UNREADABLE not in bounds:
            values = sampled_values(axis, spec, cube[:, index])
            columns.append(_canonical_column(context, name, values, path, is_written=False))
    return [Block(tuple(axes), tuple(zip(*columns, strict=False)))]
