"""Options of the command line change the file's data, and their mistakes are marked in them."""

from collections.abc import Callable
from typing import Any

import pytest

from contactlab.plan.sweep_file import SweepFile

Reader = Callable[..., SweepFile]
Mistakes = Callable[..., list[tuple[str, str]]]

BODY = """\
seeds: 2
axes:
  timestep: {values: [1e-3], role: scenario}
  cone: [pyramidal, elliptic]
zip:
  - {iterations: [1, 2], drop_height: [3, 4]}
"""


def axis(file: SweepFile, name: str) -> tuple[tuple[object, ...], str]:
    found = next(each for each in file.plan.axes if each.name == name)
    return found.values, found.role


@pytest.mark.parametrize(
    ("option", "name", "values", "role"),
    [
        ("timestep=1e-3,2e-3", "timestep", (1e-3, 2e-3), "scenario"),
        ("timestep=.5e-3", "timestep", (5e-4,), "scenario"),
        ("timestep=logspace(1e-4, 1e-2, 3)", "timestep", (1e-4, 1e-3, 1e-2), "scenario"),
        ("cone=elliptic", "cone", ("elliptic",), "knob"),
        ("solref=0.02 1,0.01 2", "solref", ((0.02, 1.0), (0.01, 2.0)), "knob"),
        ("solref=[0.02, 1]", "solref", ((0.02, 1.0),), "knob"),
        ("friction.slide=range(0, 0.3, 0.1)", "friction.slide", (0.0, 0.1, 0.2, 0.3), "knob"),
        ("multiccd=true,false", "multiccd", (True, False), "knob"),
    ],
)
def test_an_axis_is_replaced_or_added(
    read: Reader, option: str, name: str, values: tuple[object, ...], role: str
) -> None:
    assert axis(read(BODY, assign=[option]), name) == (values, role)


def test_a_key_that_an_option_begins_is_marked_there(mistakes: Mistakes) -> None:
    assert mistakes(BODY, assign=["sample.seed=3"]) == [("missing-key", "s")]
    # An effect, which this scene has not; of braces it is the entry.
    assert mistakes(BODY, assign=["limit=false"]) == [("unknown-axis", "limit")]


def test_setting_an_axis_equals_writing_it(read: Reader) -> None:
    options = ["timestep=linspace(1e-3,3e-3,3)", "seeds=5,6", "friction.slide=0,1"]
    written = read(
        "seeds: [5, 6]\n"
        "axes: {timestep: {linspace: [1e-3, 3e-3, 3], role: scenario},"
        " cone: [pyramidal, elliptic], friction.slide: [0, 1]}\n"
        "zip: [{iterations: [1, 2], drop_height: [3, 4]}]"
    )
    changed = read(BODY, assign=options)
    assert changed.sweep == written.sweep
    assert list(changed.plan.iterate_runs()) == list(written.plan.iterate_runs())


@pytest.mark.parametrize(
    ("option", "key", "value"),
    [
        ("seeds=4", "seeds", 4),
        ("seeds=4,7", "seeds", (4, 7)),
        ("duration=1", "duration", 1.0),
        ("trace=none", "trace", "none"),
        ("tolerances.energy_gain=1%", "tolerances", {"energy_gain": 0.01}),
        ("effects.multiccd=false", "effects", {"multiccd": False}),
    ],
)
def test_a_key_of_the_file_is_replaced(read: Reader, option: str, key: str, value: Any) -> None:
    assert getattr(read(BODY, assign=[option]).sweep, key) == value


def test_a_tolerance_of_an_error_may_have_a_unit(read: Reader) -> None:
    options = ["accuracy.refine=8", "tolerances.error_final=2 mm"]
    assert read(BODY, assign=options).sweep.tolerances == {"error_final": 0.002}


def test_a_replaced_mistake_is_gone(read: Reader) -> None:
    read("axes: {timestep: [oops]}\nseeds: x", assign=["timestep=1", "seeds=1"])


def test_sampling_can_be_set(read: Reader) -> None:
    plan = read(BODY, assign=["friction.slide=uniform(0,1)", "sample.n=7"]).plan
    assert plan.count == 1 * 2 * 2 * 7 * 2


@pytest.mark.parametrize(
    ("option", "code", "marked"),
    [
        ("timestp=1", "unknown-axis", "timestp"),
        ("seedz=1", "unknown-axis", "seedz"),
        ("timestep=1e-3,-2", "bad-value", "-2"),
        ("timestep=1e-3, nan", "not-finite", "nan"),
        ("timestep=linspce(1,2,3)", "unknown-key", "linspce"),
        ("timestep=linspace(1,2)", "wrong-length", "(1,2)"),
        ("timestep=linspace(1,2,x)", "wrong-type", "x"),
        ("timestep=linspace(-1,2,3)", "bad-value", "(-1,2,3)"),
        ("timestep=logspace(0,2,3)", "out-of-range", "0"),
        ("timestep=uniform(1,2)", "sample-missing", "timestep"),
        ("timestep=[1", "syntax", ""),
        ("iterations=3", "set-zipped", "iterations"),
        ("solref.timeconst=1,0", "bad-value", "0"),
        ("cone=elliptic,eliptic", "bad-value", "eliptic"),
        ("duration=x", "wrong-type", "x"),
        ("effects.multicd=true", "unknown-effect", "effects.multicd"),
        ("sample.n=0", "out-of-range", "0"),
        ("tolerances.energy=1", "unknown-metric", "tolerances.energy"),
        ("timestep", "bad-option", "timestep"),
        ("timestep=", "bad-option", "timestep="),
        ("=3", "bad-option", "=3"),
    ],
)
def test_a_mistake_is_marked_in_the_argument(
    mistakes: Mistakes, option: str, code: str, marked: str
) -> None:
    assert mistakes(BODY, assign=[option]) == [(code, marked)]


@pytest.mark.parametrize(
    ("option", "code", "marked"),
    [
        ("con=elliptic", "axis-not-swept", "con"),
        ("integrator=RK4", "axis-not-swept", "integrator"),
        ("cone=eliptic", "bad-value", "eliptic"),
        ("timestep=2e-3", "value-not-swept", "2e-3"),
        ("cone", "bad-option", "cone"),
    ],
)
def test_a_filter_that_no_run_passes_is_marked(
    mistakes: Mistakes, option: str, code: str, marked: str
) -> None:
    assert mistakes(BODY, where=[option]) == [(code, marked)]


def test_filters_must_all_hold(read: Reader) -> None:
    plan = read(BODY, where=["cone=elliptic", "iterations=2"]).plan
    kept = [(run.values["cone"], run.values["iterations"]) for run in plan.iterate_runs()]
    assert kept == [("elliptic", 2)] * 2


def test_options_and_file_are_checked_in_one_pass(mistakes: Mistakes) -> None:
    found = mistakes("axes: {timestp: [1]}", assign=["con=1"], where=["cnoe=1"])
    assert [marked for _, marked in found] == ["timestp", "con", "cnoe"]
