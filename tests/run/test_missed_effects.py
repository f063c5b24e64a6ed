"""Effects that were left out although the bodies called for them are named in the record."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store

Recorded = Callable[[str], list[EvidenceRecord]]


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    """Return what runs a sweep's text and reads its records."""

    def run(text: str) -> list[EvidenceRecord]:
        store = tmp_path / "store"
        ask = read_request(text, "t", store, folder=tmp_path, workers=0)
        run_sweep(replace(ask, fresh=True), lambda *_: None, lambda _: None)
        opened = Store.open(store)
        return [opened.record(run) for run in opened.table["run_id"].to_pylist()]

    return run


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "effect", "word"),
    [
        ("roll_friction", "rolling_friction", "floor-ball rolls from step"),
        ("spin_down", "torsional_friction", "floor-ball spins from step"),
        ("box_slide", "tangential_friction", "floor-box slides from step"),
    ],
)
def test_motion_against_friction_that_is_off_is_noticed(
    recorded: Recorded, scene: str, effect: str, word: str
) -> None:
    text = f"version: 1\nscene: {scene}\nduration: 0.2\naxes: {{{effect}: [true, false]}}\n"
    kept, left_out = recorded(text)
    assert kept.effects_missed == {}
    assert left_out.effects[effect] is False
    assert left_out.effect_reasons[effect] == "as asked"
    assert left_out.effects_missed[effect].startswith(word)


def test_a_limit_that_is_passed_is_noticed(recorded: Recorded, tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(
        "<mujoco><worldbody><body><joint name='j' type='slide' axis='0 0 1' limited='true' "
        "range='-0.1 1'/><geom size='.1'/></body></worldbody></mujoco>"
    )
    # After k steps of 2 ms z = -g h^2 k (k + 1) / 2, which passes -0.1 m with k = 71.
    text = "version: 1\nscene: m.xml\nduration: 0.3\naxes: {limit: [true, false]}\n"
    kept, left_out = recorded(text)
    assert kept.effects_missed == {}
    assert left_out.effects_missed["limit"] == "j passes its limit from step 71"


def test_nothing_is_missed_in_a_straight_drop(recorded: Recorded) -> None:
    (record,) = recorded("version: 1\nscene: ball_drop\nduration: 1.0\n")
    assert record.effects["tangential_friction"] is False
    assert record.effects_missed == {}
