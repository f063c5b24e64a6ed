"""What a configuration has to keep: the model's own error, at its peak and at the end."""

from contactlab.studies.configuration_runs import ConfigurationRows
from contactlab.studies.tune.tune_request import TuneRequest, limits_of


def rows(peak: float, final: float, divergence: float = 0.0) -> ConfigurationRows:
    row = {"error_peak": peak, "error_final": final, "divergence": divergence, "label": "stable"}
    return ConfigurationRows([{}], [[{**row, "seed": seed} for seed in range(3)]])


def excess(now: ConfigurationRows, other: ConfigurationRows, error: float | None = None) -> float:
    return limits_of(TuneRequest("model.xml", error=error), now).excess(other)


def test_an_error_that_stays_is_worse_than_one_that_passes() -> None:
    now = rows(1e-3, 1e-5)
    assert excess(now, now) <= 1
    assert excess(now, rows(1.04e-3, 1.4e-5)) <= 1
    assert excess(now, rows(1.06e-3, 1e-5)) > 1
    assert excess(now, rows(1e-3, 1e-4)) > 1


def test_an_error_that_was_asked_for_holds_at_any_time() -> None:
    assert excess(rows(1e-3, 1e-5), rows(1.9e-3, 1.9e-3), 2e-3) <= 1
    assert excess(rows(1e-3, 1e-5), rows(2.1e-3, 1e-5), 2e-3) > 1


def test_where_a_nudged_start_parts_further_that_is_the_limit() -> None:
    """Twice as far, at any time: where runs end is luck then."""
    now = rows(1e-3, 1e-5, divergence=0.1)
    assert excess(now, rows(0.19, 0.19)) <= 1
    assert excess(now, rows(0.21, 0.1)) > 1
