"""What a configuration has to keep: the model's own error, at its peak and at the end."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from contactlab.errors import ExpectationError, SceneError
from contactlab.plan.task_options import TaskOptions
from contactlab.run.sweep_request import SceneLoader
from contactlab.studies.configuration_runs import ConfigurationRows
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.session import Session
from contactlab.studies.tune.trials import Contender, Trials
from contactlab.studies.tune.tune_request import BASELINE, FRESH, TuneRequest, by_seeds, limits_of


def rows(peak: float, final: float, divergence: float = 0.0) -> ConfigurationRows:
    row = {"error_peak": peak, "error_final": final, "divergence": divergence}
    return ConfigurationRows(
        [{}], [[{**row, "label": "stable", "seed": seed} for seed in range(3)]]
    )


def excess(now: ConfigurationRows, other: ConfigurationRows, error: float | None = None) -> float:
    return limits_of(TuneRequest("model.xml", error=error), now).excess(other)


def test_an_error_that_stays_is_worse_than_one_that_passes() -> None:
    now = rows(1e-3, 1e-5)
    assert excess(now, now) <= 1
    assert excess(now, rows(1.04e-3, 1.4e-5)) <= 1
    assert excess(now, rows(1.06e-3, 1e-5)) > 1
    assert excess(now, rows(1e-3, 1e-4)) > 1


def off(*reality: float | None) -> ConfigurationRows:
    rows = [[{"reality": each, "label": "stable", "seed": 0}] for each in reality]
    return ConfigurationRows([{}] * len(rows), rows)


def test_of_reality_the_mean_over_recorded_runs_counts() -> None:
    """Single runs may be worse; 5 % more on average is as good, a tolerance is taken as it is."""
    now, request = off(0.1, 0.3), TuneRequest("scene", error="reality")
    limits = limits_of(request, now)
    assert limits.sizes == {"reality": pytest.approx(1.05 * 0.2)}
    assert limits.excess(off(0.4, 0.0)) == pytest.approx(0.2 / 0.21)
    assert limits.broken(off(0.3, 0.3), now) == "reality 0.3 over 2 runs, limit 0.21"
    assert limits.excess(off(0.1, None)) == math.inf
    asked = limits_of(replace(request, task=TaskOptions(limits={"reality": 0.5})), now)
    assert asked.sizes == {"reality": 0.5}
    with pytest.raises(ExpectationError, match="not every run has a distance from reality"):
        limits_of(request, off(0.1, None))


def test_seeds_stand_for_other_recorded_runs() -> None:
    """What proves a model was recorded apart from what the search saw, in every scenario."""
    setup = AblationSetup(SceneLoader(None), "cube_toss", (0,), scenarios=({"gravity": 9.8}, {}))
    sets = [by_seeds(setup, seeds, "reality") for seeds in (BASELINE, FRESH, range(20, 30))]
    runs = [{each["recorded_run"] for each in found.scenarios} for found in sets]
    assert [len(each) for each in runs] == [36, 120, 120]
    assert len(set.union(*runs)) == 276
    assert [len(each.scenarios) for each in sets] == [72, 240, 240]
    assert {each.seeds for each in sets} == {(0,)}
    assert by_seeds(setup, FRESH, None).seeds == tuple(FRESH)


def test_reality_needs_recorded_runs() -> None:
    with pytest.raises(SceneError, match="error reality needs a `recording` of 30 runs or more"):
        _ = TuneRequest("box_slide", error="reality").setup


def test_an_error_that_was_asked_for_holds_at_any_time() -> None:
    assert excess(rows(1e-3, 1e-5), rows(1.9e-3, 1.9e-3), 2e-3) <= 1
    assert excess(rows(1e-3, 1e-5), rows(2.1e-3, 1e-5), 2e-3) > 1


def test_no_error_is_known_better_than_its_reference() -> None:
    """Half the step of the reference moves the runs by more than the model is off."""
    now = rows(1e-3, 1e-5)
    unsure = [[{**row, "error_estimate": 3e-3} for row in now.flat]]
    assert excess(ConfigurationRows([{}], unsure), rows(3.1e-3, 1e-5)) <= 1
    assert excess(ConfigurationRows([{}], unsure), rows(3.2e-3, 1e-5)) > 1


def test_where_a_nudged_start_parts_further_that_is_the_limit() -> None:
    """Twice as far, at any time: where runs end is luck then."""
    now = rows(1e-3, 1e-5, divergence=0.1)
    assert excess(now, rows(0.19, 0.19)) <= 1
    assert excess(now, rows(0.21, 0.1)) > 1


def test_a_model_that_was_never_timed_has_no_time(tmp_path: Path) -> None:
    """Where the search finds nothing, there is nothing to time it beside."""
    setup = AblationSetup(SceneLoader(None), "model.xml", (0,))
    now = rows(1e-3, 1e-5)
    limits = limits_of(TuneRequest("model.xml"), now)
    trials = Trials(setup, Session(tmp_path), 0.0, limits)
    assert Contender({}, now).reported("now", trials).time is None


def test_what_is_written_anew_under_the_same_name_is_timed_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the first contender fails its proof, the second takes its place in `tuned`."""
    timed: list[Any] = []
    monkeypatch.setattr(Trials, "_turns", lambda *asked: timed.append(asked) or [[1.0, 2.0]])
    now, tuned = tmp_path / "model.xml", tmp_path / "tuned.xml"
    for damping in (1, 1, 2):
        for path, value in ((now, 1), (tuned, damping)):
            path.write_text(
                f'<mujoco><worldbody><body><joint damping="{value}"/><geom size=".1"/></body>'
                "</worldbody></mujoco>"
            )
        setup, other = (AblationSetup(SceneLoader(None), str(each), (0,)) for each in (now, tuned))
        assert Trials(setup, Session(tmp_path), 0.0).costs([(other, {})])[0].ratio == 2
    assert len(timed) == 2
