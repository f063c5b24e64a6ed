"""Statements about what a test recorded: true of what went well, and of nothing else."""

from pathlib import Path
from typing import Any

import mujoco
import pytest

from contactlab.errors import OutputError
from contactlab.store.verify_store import write_baseline
from contactlab.testing import evidence
from contactlab.testing.evidence import ContactEvidence

SHELF = """
<mujoco><option timestep="0.002"/><worldbody>
  <geom name="shelf" type="box" size=".1 .1 .01"/>
  <body name="mug" pos="0 0 {height}"><freejoint/>
    <geom name="mug" type="box" size=".05 .05 .05" mass="1"/></body>
</worldbody></mujoco>"""


def end() -> None:
    raise KeyError("mug")


@pytest.fixture(autouse=True)
def _without_a_page(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise OutputError("no page here")

    monkeypatch.setattr(evidence, "write_page", refuse)


@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize(("height", "label"), [(0.06, None), (0.03, "penetration")])
def test_only_whole_episodes_without_labels_are_stable(
    tmp_path: Path, *, cut: bool, height: float, label: str | None
) -> None:
    """An episode is whole unless its loop was cut; a mug that begins 30 mm deep gets labels."""
    model = mujoco.MjModel.from_xml_string(SHELF.format(height=height))
    recorded = ContactEvidence(tmp_path / "store")
    try:
        with recorded.record(model, mujoco.MjData(model)) as recording:
            recording.step(50)
            if cut:
                end()
    except KeyError:
        assert cut
    if not cut and label is None:
        assert recorded.stable()
        return
    with pytest.raises(AssertionError) as raised:
        recorded.stable()
    said = str(raised.value)
    assert ("stopped: cut after 50 steps" in said) == cut
    assert (" at step " in said) == (label is not None)


@pytest.mark.parametrize(
    ("height", "episodes", "said"),
    [(0.06, 1, ""), (0.03, 1, "worse: "), (0.06, 2, "not comparable: ")],
)
def test_only_evidence_that_is_no_worse_is_within_a_baseline(
    tmp_path: Path, height: float, episodes: int, said: str
) -> None:
    """Neither a deeper mug is, nor a recording that cannot be compared."""

    def record_shelf(name: str, height: float, episodes: int) -> ContactEvidence:
        model = mujoco.MjModel.from_xml_string(SHELF.format(height=height))
        data, recorded = mujoco.MjData(model), ContactEvidence(tmp_path / name)
        with recorded.record(model, data) as recording:
            for _ in range(episodes):
                recording.step(50)
                mujoco.mj_resetData(model, data)
        return recorded

    record_shelf("before", 0.06, 1)
    write_baseline(tmp_path / "before", tmp_path / "baseline")
    recorded = record_shelf("now", height, episodes)
    if not said:
        assert recorded.within(tmp_path / "baseline")
        return
    with pytest.raises(AssertionError, match=f"^{said}"):
        recorded.within(tmp_path / "baseline")
