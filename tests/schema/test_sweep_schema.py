"""The published JSON Schemas say of a file what the models say, as far as a schema can."""

from collections.abc import Iterator
from typing import Any, cast

import pytest
from jsonschema import Draft7Validator, Draft202012Validator
from pydantic import ValidationError

from contactlab.schema.json_schemas import (
    EMITTED,
    WRITTEN,
    json_schemas,
)
from contactlab.schema.sweep_schema import Sweep

GOOD: dict[str, Any] = {
    "version": 1,
    "scene": "ball_drop",
    "description": "which timestep is enough",
    "duration": 3,
    "drive": {"policy": "balance.py:Balance", "latency": 0.01, "noise": {"qpos": 1e-3}},
    "seeds": [0, 4],
    "axes": {
        "timestep": {"logspace": [5e-4, 2e-2, 8]},
        "solref": ["0.02 1", [0.005, 1]],
        "solimp.dmin": {"linspace": [0.9, 0.99, 3]},
        "drop_height": {"values": [0.5, 1], "role": "scenario"},
        "friction.slide": {"uniform": [0.3, 1.0]},
        "iterations": {"range": [10, 50, 10]},
        "multiccd": [True, False],
    },
    "zip": [{"mass": [1, 2], "gravity": {"values": [9.81, 3.7]}}],
    "sample": {"method": "lhs", "n": 16, "seed": 3},
    "refine": {"axes": ["timestep"], "to": 8, "where": "slip > 1mm", "probe": "5%", "start": 2},
    "until": {"share": "failed", "half_width": "2%", "sure": 0.9},
    "limit": {"largest": "timestep", "to": 17, "where": "must"},
    "search": {"maximise": "penetration_max", "axes": ["timestep"], "runs": 50},
    "exclude": [{"where": "timestep > 1e-3", "solref": "0.02 1"}, {"multiccd": True}],
    "include": [{"timestep": 1e-4}],
    "effects": {"energy": False},
    "must": [
        "still(ball, 1 mm, from: 0.5 s)",
        "held(mug, by: hand)",
        "passes(peg, hole)",
        "apart(floor-ball, until: 0.3)",
        "sticks(ball, last)",
        "presses(ball, ..9 N)",
        "shallow(*, 1 mm)",
    ],
    "tolerances": {"penetration_max": 1e-3, "energy_gain": "1%"},
    "thresholds": {"chatter": 5},
    "expect": [
        {"where": {"timestep": 1e-3}, "label": "stable"},
        {"label": ["tunneling"], "metrics": {"penetration_max": {"min": 0}}, "reason": "control"},
        {"must": "rolls(ball)"},
    ],
    "trace": "sample:10",
    "trace_format": "compact",
    "checks": "all",
    "knife_edge": True,
    "baseline": True,
    "accuracy": {"against": "written", "error": "local", "refine": 8},
    "timing": {"rounds": 5},
    "latency_budget": 2e-3,
    "timeout": 5,
}

BAD: list[dict[str, Any]] = [
    {"drive": "limp"},
    {"drive": {"noise": 2}},
    {"drive": {"policy": "balance.py"}},
    {"axes": {"timestep": {"logspace": [1, 2]}}},
    {"axes": {"timestep": {"linspace": [1, 2, 3, 4]}}},
    {"axes": {"timestep": {"linspace": [1, 2, 2.5]}}},
    {"axes": {"timestep": {"logspace": [0, 2, 3]}}},
    {"axes": {"timestep": {"uniform": [1]}}},
    {"axes": {"timestep": {"logspce": [1, 2, 3]}}},
    {"axes": {"timestep": {"values": [1], "role": "nob"}}},
    {"axes": {"timestep": {"values": [1], "range": [1, 2, 1]}}},
    {"axes": {"timestep": []}},
    {"axes": {"timestep": 1e-3}},
    {"axes": {"solref": [[0.02, "x"]]}},
    {"axes": {"timestep": [None]}},
    {"zip": [{}]},
    {"seeds": 0},
    {"seeds": [0.5]},
    {"sample": {"n": 0}},
    {"sample": {"method": "sobol"}},
    {"refine": {"axes": ["timestep"]}},
    {"refine": {"axes": [], "to": 9}},
    {"refine": {"axes": ["a", "b", "c", "d"], "to": 9}},
    {"refine": {"axes": ["a"], "to": 2}},
    {"refine": {"axes": ["a"], "to": 9, "probe": 2}},
    {"search": {"runs": 0, "maximise": "x"}},
    {"until": {"share": "failed"}},
    {"until": {"share": "failed", "half_width": 0.5}},
    {"exclude": [{"where": 3}]},
    {"include": {"file": 3}},
    {"include": {"fil": "x.csv"}},
    {"effects": {"energy": "auto"}},
    {"tolerances": {"energy_gain": "1 percent"}},
    {"expect": [{"label": []}]},
    {"pairs": []},
    {"expect": [{"label": "stable", "mode": "stick"}]},
    {"must": "stil(ball)"},
    {"must": ["still(ball)", "upright torso"]},
    {"trace": "sample:0"},
    {"trace_format": "small"},
    {"accuracy": {"error": "global"}},
    {"accuracy": {"refine": 1}},
    {"timing": {"rounds": 2}},
    {"duration": 0},
    {"version": 2},
    {"durations": 3},
]


def validator() -> Draft7Validator:
    schema = json_schemas()["sweep.schema.json"]
    Draft7Validator.check_schema(schema)
    return Draft7Validator(schema)


def accepted(data: dict[str, Any]) -> bool:
    try:
        Sweep.model_validate(data)
    except ValidationError:
        return False
    return True


def test_a_full_file_is_accepted_by_both() -> None:
    assert validator().is_valid(GOOD)  # pyright: ignore[reportUnknownMemberType]
    assert accepted(GOOD)
    assert set(GOOD) == set(Sweep.model_fields)


@pytest.mark.long
@pytest.mark.parametrize("change", BAD)
def test_a_mistake_is_refused_by_both(change: dict[str, Any]) -> None:
    data = GOOD | change
    assert not validator().is_valid(data)  # pyright: ignore[reportUnknownMemberType]
    assert not accepted(data)


def test_a_model_reads_what_it_writes() -> None:
    sweep = Sweep.model_validate(GOOD)
    data = sweep.model_dump(mode="json", exclude_none=True)
    assert Sweep.model_validate(data) == sweep
    assert Sweep.model_validate_json(sweep.model_dump_json()) == sweep
    assert validator().is_valid(data)  # pyright: ignore[reportUnknownMemberType]


def test_percentages_are_fractions() -> None:
    sweep = Sweep.model_validate({"version": 1, "scene": "x", "tolerances": {"a": "2.5%"}})
    assert sweep.tolerances == {"a": 0.025}


def test_seeds_are_a_count_or_a_list() -> None:
    assert Sweep(version=1, scene="x", seeds=3).seed_values == (0, 1, 2)
    assert Sweep(version=1, scene="x", seeds=(5, 3)).seed_values == (5, 3)


def parts(schema: object) -> Iterator[dict[str, Any]]:
    if isinstance(schema, dict):
        yield cast("dict[str, Any]", schema)
        for inner in cast("dict[str, object]", schema).values():
            yield from parts(inner)
    elif isinstance(schema, list):
        for inner in cast("list[object]", schema):
            yield from parts(inner)


@pytest.mark.parametrize("name", sorted(WRITTEN))
def test_schemas_of_files_that_people_write_are_draft_07(name: str) -> None:
    schema = json_schemas()[name]
    assert schema["$schema"] == "http://json-schema.org/draft-07/schema#"
    for part in parts(schema):
        assert not {"prefixItems", "$defs", "discriminator"} & set(part)
        assert part.get("type") != "null"
        assert "$ref" not in part or len(part) == 1


def test_every_key_of_a_sweep_file_is_described() -> None:
    for part in parts(json_schemas()["sweep.schema.json"]):
        for name, key in part.get("properties", {}).items():
            assert key.get("description"), name


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(EMITTED))
def test_schemas_of_files_that_contactlab_writes_are_sound(name: str) -> None:
    Draft202012Validator.check_schema(json_schemas()[name])
