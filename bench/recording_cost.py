"""What recording adds to a plain Python loop over `mj_step`, with eight monitored pairs.

    python -m bench.recording_cost

Eight boxes lie on a floor, or an arm of eight links is driven; all eight pairs are monitored. Both
loops make three episodes. They take turns, so that both meet the same machine;
ratios are of medians of the rounds' CPU times. What an episode's end takes (measuring, labelling,
storing) is given by itself: it is no part of the loop.
"""

import tempfile
from pathlib import Path
from statistics import median
from time import thread_time

import mujoco
import numpy as np

import contactlab

ROUNDS, EPISODES, STEPS = 9, 3, 2000


def boxes() -> str:
    """Return eight boxes on a floor."""
    bodies = "".join(
        f'<body pos="{each % 4} {each // 4} .1"><freejoint/>'
        f'<geom name="box{each}" type="box" size=".1 .1 .1" mass="1"/></body>'
        for each in range(8)
    )
    return (
        '<mujoco><worldbody><geom name="floor" type="plane" size="9 9 .1"/>'
        f"{bodies}</worldbody></mujoco>"
    )


def balls() -> str:
    """Return eight balls on a floor, whose steps are as cheap as those of eight pairs can be."""
    return boxes().replace('type="box" size=".1 .1 .1"', 'size=".1"')


def taken(text: str, recording: bool) -> tuple[float, float]:
    """Return the CPU time of a loop's steps, and of its end [s]."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    monitor = [("floor", f"box{each}") for each in range(8)]
    if not recording:
        stepping = 0.0
        for _ in range(EPISODES):
            mujoco.mj_resetData(model, data)
            begin = thread_time()
            for _ in range(STEPS):
                mujoco.mj_step(model, data)
            stepping += thread_time() - begin
        return stepping, 0.0
    stepping = ending = 0.0
    with tempfile.TemporaryDirectory() as folder:
        recorder = contactlab.record(model, data, Path(folder) / "store", monitor=monitor)
        for _ in range(EPISODES):
            mujoco.mj_resetData(model, data)
            begin = thread_time()
            for _ in range(STEPS):
                recorder.step()
            end = thread_time()
            recorder.reset()
            stepping, ending = stepping + end - begin, ending + thread_time() - end
        recorder.close()
    return stepping, ending


def main() -> None:
    """Print what a step takes, and what recording adds."""
    print("model     plain [us]   recorded [us]   added    end of episode [us a step]")
    for name, text in (("boxes", boxes()), ("balls", balls())):
        rounds = [(*taken(text, False), *taken(text, True)) for _ in range(ROUNDS)]
        plain, _, recorded, ended = (
            1e6 / EPISODES / STEPS * median(each) for each in np.array(rounds).T
        )
        ratios = [each[2] / each[0] - 1 for each in rounds]
        print(f"{name:8} {plain:10.1f} {recorded:14.1f} {median(ratios):10.1%} {ended:18.1f}")


if __name__ == "__main__":
    main()
