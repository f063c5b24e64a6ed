"""What goes on to be timed is what may still be recommended, as a slow loop has it."""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

from hypothesis import given
from hypothesis import strategies as st
from tests.run.bare_runs import bare_run

from contactlab.run import passes
from contactlab.run.passes import SweepSession
from contactlab.scene.run_spec import RunSpec
from contactlab.schema.sweep_schema import Sweep

# Few values, so that many are equal; errors and depths of a configuration in two scenarios.
VALUES = st.sampled_from([0.0, 0.5, 1.0, 1.5, 2.0])
CONFIGURATIONS = st.lists(
    st.tuples(st.tuples(VALUES, VALUES), st.tuples(VALUES, VALUES), st.booleans(), VALUES),
    min_size=1,
    max_size=6,
)
DEPTH, ERROR = "penetration_max", "error_final"


@given(CONFIGURATIONS)
def test_one_goes_on_unless_another_is_as_good_and_clearly_faster(
    known: Sequence[tuple[tuple[float, float], tuple[float, float], bool, float]],
) -> None:
    """As good in error and in margin, and faster by more than a quarter; infeasible ones stop.

    A configuration is judged by its worst scenario. Where none is feasible, all are compared.
    """
    sweep = Sweep.model_validate(
        {
            "version": 1,
            "scene": "ball_drop",
            "axes": {
                "timestep": [1e-3 * (1 + place) for place in range(len(known))],
                "drop_height": {"values": [0.1, 0.2], "role": "scenario"},
            },
            "accuracy": {},
            "tolerances": {DEPTH: 1.0, ERROR: 1.0},
        }
    )
    runs, times = list[RunSpec](), dict[str, float]()
    outcomes, errors = dict[str, Any](), dict[str, Any]()
    for place, (errs, depths, stable, time) in enumerate(known):
        for number in range(2):
            run_id = f"{place}-{number}"
            axes = {"timestep": 1e-3 * (1 + place), "drop_height": 0.1 * (1 + number)}
            runs.append(bare_run(len(runs), run_id).with_seed(axes, 0, run_id, len(runs)))
            label = "stable" if stable or not number else "chatter"
            outcomes[run_id] = {"label": label, DEPTH: -depths[number]}
            errors[run_id] = {ERROR: errs[number]}
            times[run_id] = (1 + time) * (1 + 0.1 * number)
    task = SimpleNamespace(sweep=sweep)
    session = SimpleNamespace(task=task, planned_runs=runs, outcomes=outcomes)
    select = passes._Contenders(  # pyright: ignore[reportPrivateUsage]
        cast("SweepSession", session), runs, errors
    )
    found = {group[0].partition("-")[0] for group in select(times)}

    judged = [
        (max(errs), math.inf if not stable else max(*errs, *depths), 1 + time)
        for errs, depths, stable, time in known
    ]
    able = [one for one in judged if one[1] <= 1] or judged
    expected = {
        str(place)
        for place, (error, used, time) in enumerate(judged)
        if (error, used, time) in able
        and not any(
            1.25 * least < time and other <= error and part <= used for other, part, least in able
        )
    }
    assert found == expected
