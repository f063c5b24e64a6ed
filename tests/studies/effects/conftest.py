"""Ablations of a scene, a sweep or a model, with few seeds and in this process."""

from collections.abc import Callable

import pytest

from contactlab.schema.study_reports import RecordedEffectsReport
from contactlab.studies.effects import ablation
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.tasks.session import Session

Ablate = Callable[..., RecordedEffectsReport]


@pytest.fixture(scope="session")
def ablate(tmp_path_factory: pytest.TempPathFactory) -> Ablate:
    """Return what writes a sweep or a model and ablates it; costs are left out unless asked."""

    def run(
        text: str,
        *assign: str,
        name: str = "asked.yaml",
        seeds: int = 2,
        rounds: int | None = None,
        workers: int = 0,
    ) -> RecordedEffectsReport:
        folder = tmp_path_factory.mktemp("ablation")
        source = folder / name
        source.write_text(text)
        request = EffectsRequest(str(source), assign, seeds, rounds)
        return ablation.find_smallest_set(request, Session(folder / "stores", workers))

    return run
