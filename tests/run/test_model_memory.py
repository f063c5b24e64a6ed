"""A worker holds as many models as memory allows, since meshes are large."""

from typing import Any

import mujoco
import pytest

from contactlab.run import planned_runs

pytestmark = pytest.mark.long


@pytest.mark.parametrize("models", [1, 2])
def test_a_bound_on_models_changes_nothing(
    models: int, sweeper: Any, ball: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweeper.run(ball, "usual")
    base = sweeper.ask(ball).scene.base({})
    assert base.size == mujoco.mj_sizeModel(base.model)
    portions: list[int] = []
    held: list[int] = []
    plans = planned_runs.Preparer.plan_job

    def watched(self: planned_runs.Preparer, job: Any) -> Any:
        portions.append(len(job))
        made = plans(self, job)
        held.append(len(vars(self)["_models"]))
        return made

    monkeypatch.setattr(planned_runs.Preparer, "plan_job", watched)
    monkeypatch.setattr(planned_runs, "MODEL_BYTES", models * base.size)
    sweeper.run(ball, "bounded")
    assert sweeper.outcome("bounded") == sweeper.outcome("usual")
    assert max(portions) == max(held) == models
