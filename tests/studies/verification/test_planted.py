"""Planted harm is found by the name of its measure, and changes without harm pass."""

from pathlib import Path

import pytest
from _pytest.mark.structures import ParameterSet
from tests.studies.verification.planted import (
    HARMFUL,
    HARMFUL_TO_PILES,
    HARMLESS,
    HARMLESS_TO_PILES,
    PlantedChange,
)

from contactlab.studies.verification import VerificationRequest, verify_change
from contactlab.tasks.checked_model import CheckedModel, open_model
from contactlab.tasks.session import Session

FAST = {"Euler for Runge-Kutta"}
"""A second case of each kind takes seconds, and the other cases minutes together."""
LONG = {"half the servo gain", "another solver of a pendulum", "a joint without its limit"}


def _marked(changes: tuple[PlantedChange, ...]) -> list[ParameterSet]:
    return [
        pytest.param(
            change,
            id=change.name,
            marks=[]
            if change.name in FAST
            else pytest.mark.long
            if change.name in LONG
            else pytest.mark.night,
        )
        for change in changes
    ]


def _open(path: Path, text: str) -> CheckedModel:
    path.parent.mkdir()
    path.write_text(text)
    return open_model(str(path), Session(path.parent / "results"))


def _pair(folder: Path, change: PlantedChange) -> tuple[CheckedModel, CheckedModel]:
    return (
        _open(folder / "original" / "model.xml", change.model),
        _open(folder / "changed" / "model.xml", change.changed),
    )


@pytest.mark.parametrize("change", _marked(HARMFUL))
def test_harm_is_found_by_its_measure(change: PlantedChange, tmp_path: Path) -> None:
    original, changed = _pair(tmp_path, change)
    request = VerificationRequest(original, changed, same_model=change.same_model, most_seeds=1)
    found = verify_change(request)
    worse = {measure.name for measure in found.measures if measure.worse}
    assert worse & {*change.measures}, found.sentence
    assert not found.passed
    assert not found.identical


@pytest.mark.parametrize("change", _marked(HARMFUL))
def test_harm_is_found_in_a_fix_that_moves_bodies_otherwise(
    change: PlantedChange, tmp_path: Path
) -> None:
    original, changed = _pair(tmp_path, change)
    request = VerificationRequest(
        original,
        changed,
        same_model=False,
        keeps_motion=False,
        allowed_error=original.task.tolerance,
        stop_early=True,
        most_seeds=1,
    )
    assert not verify_change(request).passed


@pytest.mark.parametrize("change", _marked(HARMLESS))
def test_no_harm_passes(change: PlantedChange, tmp_path: Path) -> None:
    original, changed = _pair(tmp_path, change)
    found = verify_change(VerificationRequest(original, changed))
    assert found.passed, found.sentence


@pytest.mark.parametrize("change", _marked(HARMFUL_TO_PILES))
def test_harm_to_a_chaotic_pile_is_found(change: PlantedChange, tmp_path: Path) -> None:
    original, changed = _pair(tmp_path, change)
    assert not verify_change(VerificationRequest(original, changed, stop_early=True)).passed


@pytest.mark.parametrize("change", _marked(HARMLESS_TO_PILES))
def test_no_harm_to_a_chaotic_pile_passes(change: PlantedChange, tmp_path: Path) -> None:
    original, changed = _pair(tmp_path, change)
    found = verify_change(VerificationRequest(original, changed, stop_early=True))
    assert found.passed, found.sentence
