"""What a page draws of a run over time is what its trace has, at the times of the trace."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from contactlab.contact.trace_arrays import NO_CONTACT, SLIDE, STICK
from contactlab.page.run_series import qpos_entries, run_series
from contactlab.schema.coverage import Travel
from contactlab.store.mcap.trace_reader import StoredPair

STEP = 0.25  # a power of 2, so that no time is rounded
STEPS = st.lists(
    st.tuples(st.sampled_from([NO_CONTACT, STICK, SLIDE]), st.integers(-8, 8)),
    max_size=40,
)


@given(steps=STEPS)
def test_modes_begin_and_depths_are_as_recorded(steps: list[tuple[int, int]]) -> None:
    """Depth is minus the distance, at least 0, and 0 without contact; a mode lasts to the next."""
    touching = [place for place, (mode, _) in enumerate(steps) if mode != NO_CONTACT]
    modes = np.array([steps[place][0] for place in touching], np.int8)
    distance = np.array([steps[place][1] / 8 for place in touching])
    counts, zeros = np.ones(len(touching), np.int32), np.zeros(len(touching))
    pair = StoredPair(
        name="floor-ball",
        steps=np.array(touching, np.int32),
        contacts=counts,
        found=counts,
        mode=modes,
        normal=zeros,
        tangential=zeros,
        usage=zeros,
        slip=zeros,
        distance=distance,
        points=np.zeros((0, 23)),
    )
    count = len(steps)
    trace: Any = SimpleNamespace(
        time=STEP * np.arange(count + 1),
        qpos=np.zeros((count + 1, 1)),
        contacts=np.zeros(count, np.int32),
        pairs=(pair,),
        model_xml=b"<mujoco/>",
    )
    named, columns = run_series(trace)
    if not steps:  # a run that ended before its first step
        assert named["bands"] == []
        return
    depth = next(n for n, each in enumerate(named["signals"]) if each[0] == "floor-ball depth")
    drawn = dict(zip(columns[f"t{depth}"].tolist(), columns[f"v{depth}"].tolist(), strict=True))
    assert drawn == {
        STEP * place: max(-each / 8, 0.0) if mode != NO_CONTACT else 0.0
        for place, (mode, each) in enumerate(steps)
    }
    begins = np.searchsorted(columns["s0"], STEP * np.arange(count), side="right") - 1
    assert columns["m0"][begins].tolist() == [mode for mode, _ in steps]
    assert (np.diff(columns["m0"].astype(int)) != 0).all()


def test_joints_of_included_files_are_named_by_their_coverage() -> None:
    """A free joint has seven entries, of which three are lengths; a ball has none of them."""
    covered = {"base": Travel(turned=0.0), "knee": Travel(), "jaw": Travel(share=0.5)}
    including = b"<mujoco><include file='robot.xml'/></mujoco>"
    named = [(entry.index, entry.name) for entry in qpos_entries(including, 9, covered)]
    assert named == [(0, "base x"), (1, "base y"), (2, "base z"), (7, "knee"), (8, "jaw")]
    with_a_ball = qpos_entries(including, 12, {**covered, "hip": Travel()})
    assert [entry.name for entry in with_a_ball] == [f"qpos[{index}]" for index in range(12)]


@given(offset=st.floats(-10, 10), size=st.floats(1e-4, 1))
def test_a_small_motion_far_from_zero_is_drawn_within_a_percent(offset: float, size: float) -> None:
    count = 50
    motion = offset + size * np.sin(np.arange(count + 1) / 8)[:, None]
    trace: Any = SimpleNamespace(
        time=STEP * np.arange(count + 1),
        qpos=motion,
        contacts=np.zeros(count, np.int32),
        pairs=(),
        model_xml=b"<mujoco/>",
    )
    _, columns = run_series(trace)
    places = (columns["t0"] / STEP).astype(int)
    assert np.abs(columns["v0"] - motion[places, 0]).max() <= 1e-2 * size
