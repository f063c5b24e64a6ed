"""Metrics, labels and oracles that a plug-in declares are as good as those of this package."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import PluginError
from contactlab.measure import (
    LABELS,
    METRICS,
    ORACLES,
    Context,
    MeasuredRuns,
    Onset,
    Onsets,
    Threshold,
    assess_runs,
    label,
    metric,
    oracle,
    threshold_values,
)
from contactlab.measure.entries import OnsetIterator
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.store.finished_store import Store

pytestmark = pytest.mark.usefixtures("_registries_restored")


def declare_top_speed() -> Callable[[Context], Floats]:
    @metric(unit="rad/s", better="lower", resolution=1e-9)
    def top_speed(context: Context) -> Floats:
        """Largest velocity of any joint.

        At any
        time.
        """
        return np.abs(context.trace.qvel).max(axis=(1, 2))

    return top_speed


def declare_racing(rank: float = 7.5) -> None:
    limit = Threshold("top_speed", 10.0, "rad/s", "Largest metric top_speed.")

    @label("poor", rank=rank, thresholds=(limit,))
    def racing(runs: MeasuredRuns) -> Onsets:
        """A joint moves faster than its limit."""
        return {run: Onset(f"at {speed:g} rad/s", 0) for run, speed, _ in runs.over("top_speed")}


def test_a_label_is_of_the_bodies_of_all_that_it_finds(trace_of: Any, setup_of: Any) -> None:
    @label("poor")
    def touched(_: MeasuredRuns) -> OnsetIterator:
        """Something was touched."""
        yield 0, Onset("the box, first", 3, ("box", "lid"))
        yield 1, Onset("the box", 4, ("box",))
        yield 0, Onset("the lid, too", 5, ("lid", "key"))
        yield 1, Onset("all of it", 6)

    trace = trace_of(2)
    found = assess_runs(trace, setup_of(trace)).labels
    assert found[0][0] == ("touched", "the box, first", 3, ("box", "lid", "key"))
    # What is of the whole run is of no body.
    assert found[1][0] == ("touched", "the box", 4, ())


def test_a_metric_with_its_label_is_measured(trace_of: Any, setup_of: Any) -> None:
    function = declare_top_speed()
    declare_racing()
    trace = trace_of(2)
    trace.qvel[1, 3, 4] = -20
    found = assess_runs(trace, setup_of(trace))
    assert found.metrics["top_speed"].tolist() == [0, 20]
    assert found.labels[1][0] == ("racing", "at 20 rad/s", 0, ())
    assert found.labels[0][0].label == "stable"
    lenient = assess_runs(trace, setup_of(trace, thresholds={"top_speed": 30.0}))
    assert [each.label for each in lenient.labels[1]] == ["stable"]
    entry = METRICS["top_speed"]
    assert (entry.definition, entry.function) == (
        "Largest velocity of any joint. At any time.",
        function,
    )
    assert (entry.version, entry.kind, entry.tolerance) == (1, "physics", 0.0)
    assert LABELS["racing"].meaning == "A joint moves faster than its limit."
    assert threshold_values({})["top_speed"] == 10


def test_a_sweep_stores_it_as_it_does_ours(tmp_path: Path) -> None:
    declare_top_speed()
    declare_racing()
    sweep = "version: 1\nscene: ball_drop\nduration: 1\ntrace: none\nthresholds: {top_speed: 1}\n"
    request = read_request(sweep, "t", tmp_path / "s", folder=tmp_path, workers=0)
    run_sweep(request, lambda *_: None, lambda _: None)
    store = Store.open(tmp_path / "s")
    record = store.record(store.table["run_id"][0].as_py())
    speed = record.metrics["top_speed"]
    assert speed is not None
    assert speed > 1
    assert (record.units["top_speed"], record.metric_versions["top_speed"]) == ("rad/s", 1)
    assert "racing" in [each.label for each in record.labels]
    assert store.table["top_speed"].to_pylist() == [speed]
    assert "racing" in store.columns.shared["severity"]


def test_metrics_come_last_and_labels_by_severity() -> None:
    ours = list(LABELS)
    declare_top_speed()
    declare_racing()
    assert list(METRICS)[-1] == "top_speed"
    place = ours.index("drift")
    assert list(LABELS) == [*ours[:place], "racing", *ours[place:]]


def test_labels_of_equal_severity_keep_their_order() -> None:
    declare_racing(LABELS["drift"].rank)
    names = list(LABELS)
    assert names.index("racing") == names.index("drift") + 1


def test_tolerances_are_those_of_the_unit_unless_stated() -> None:
    assert METRICS["penetration_max"].tolerance == 1e-4
    assert METRICS["energy_gain"].tolerance == 0.01
    assert METRICS["mode_switches"].tolerance == 5


def test_an_oracle_is_expected_of_its_scene(trace_of: Any, setup_of: Any) -> None:
    @oracle(unit="s", settings=("speed",), relative=True)
    def two_seconds(context: Context) -> tuple[Floats, Floats]:
        """Twice the speed."""
        return 2 * context.setting("speed"), context.setting("speed")

    trace = trace_of()
    setup = setup_of(trace, oracle="two_seconds", oracle_tolerance=0.1, settings={"speed": [3.0]})
    found = assess_runs(trace, setup)
    assert found.metrics["oracle_error"] == 0.5
    assert [each.label for each in found.labels[0]] == ["oracle_miss"]
    assert ORACLES["two_seconds"].definition == "Twice the speed."


@pytest.mark.parametrize("name", ["penetration_max", "repeats"])
def test_a_name_that_is_taken_is_refused(name: str) -> None:
    def mine(context: Context) -> Floats:
        """Mine."""
        return context.undefined()

    with pytest.raises(PluginError, match=f"a metric named '{name}' already"):
        metric(unit="1", name=name)(mine)
    with pytest.raises(PluginError, match="a threshold named 'drift' already"):
        label("noted", thresholds=(Threshold("drift", 1.0, "m", "Mine."),))(_nothing)


def test_an_entry_needs_a_definition() -> None:
    def bare(context: Context) -> Floats:
        return context.undefined()

    with pytest.raises(PluginError, match="'bare' has no docstring"):
        metric(unit="1")(bare)


def _nothing(_runs: MeasuredRuns) -> Onsets:
    """Nothing is wrong."""
    return {}
