"""Every command has an answer about a robot that moves, for robots that nobody here has written.

They come from Python packages that are installed, or unpacked in the folder that ROBOT_WHEELS
names; nothing here depends on them. Runs are short: that there is an answer is asserted, not which.
The answers are written into the file that ROBOT_TABLE names.
"""

import importlib.util
import json
import os
import re
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.accuracy import timing
from contactlab.store.finished_store import Store

Run = Callable[..., Any]
_GYM, _ROBOTICS = "gymnasium/envs/mujoco/assets", "gymnasium_robotics/envs/assets"
_SUITE, _ARMS = "dm_control/suite", "robosuite/models/assets/robots"
ROBOTS = (
    *(f"{_GYM}/{name}.xml" for name in ("ant", "half_cheetah", "hopper", "humanoid")),
    *(f"{_GYM}/{name}.xml" for name in ("inverted_double_pendulum", "pusher_v5", "walker2d_v5")),
    f"{_GYM}/swimmer.xml",
    *(f"{_ROBOTICS}/fetch/{name}.xml" for name in ("pick_and_place", "slide")),
    *(f"{_ROBOTICS}/{name}.xml" for name in ("hand/manipulate_block", "adroit_hand/adroit_door")),
    *(f"{_ARMS}/{name}/robot.xml" for name in ("panda", "ur5e", "jaco", "kinova3", "xarm7")),
    *(f"{_SUITE}/{name}.xml" for name in ("acrobot", "cartpole", "cheetah", "finger", "fish")),
    *(f"{_SUITE}/{name}.xml" for name in ("humanoid", "manipulator", "quadruped", "walker")),
)
MISSED = {}
SECONDS = 0.6
COMMANDS = ("sweep", "checks", "labels", "effects", "tradeoff")


def tell(robot: str, command: str, code: int, start: float, verdict: str) -> None:
    """Add an answer to the table in the file that ROBOT_TABLE names, if it does."""
    seconds = time.perf_counter() - start
    if name := os.environ.get("ROBOT_TABLE"):
        with Path(name).open("a", encoding="utf-8") as file:
            file.write(f"{robot:46} {command:9} {code} {seconds:6.1f}  {verdict}\n")


def model_of(robot: str) -> Path:
    """Return the robot's model file; skip the test if its package is not here."""
    package, _, rest = robot.partition("/")
    places = [Path(folder) / package for folder in filter(None, [os.environ.get("ROBOT_WHEELS")])]
    spec = importlib.util.find_spec(package)
    places += map(Path, spec.submodule_search_locations or ()) if spec else ()
    found = [place / rest for place in places if (place / rest).is_file()]
    if not found:
        pytest.skip(f"{package} is not installed, and not in the folder that ROBOT_WHEELS names")
    return found[0]


def moved(folder: Path) -> bool:
    """Return whether a joint moved in any run of the stores below a folder."""
    stores = [Store.open(path.parent) for path in folder.rglob("sweep.json")]
    records = [each.record(run) for each in stores for run in each.table["run_id"].to_pylist()]
    uses = [record.coverage.joints for record in records if record.coverage]
    return any(joint.counts for joints in uses for joint in joints.values())


def words(command: str, data: Any) -> str:
    """Return a command's verdict in a few words."""
    match command:
        case "checks":
            failed = [each["name"] for each in data["checks"] if each["verdict"] == "fail"]
            return f"{len(data['checks'])} checks; fails {', '.join(failed) or 'none'}"
        case "labels":
            return data["headline"]
        case "effects":
            return f"{len(data['smallest_set']['off'])} of {len(data['effects'])} can be left out"
        case _:
            best = data["recommendation"]
            if best is None:
                return f"none of {len(data['configurations'])} configurations is feasible"
            return f"{best['configuration']}, x{best['real_time_factor']:.0f} real time"


@pytest.mark.night
@pytest.mark.filterwarnings("ignore::contactlab.errors.ModelWarning")
@pytest.mark.parametrize(
    "robot",
    [
        *ROBOTS,
        *(pytest.param(robot, marks=pytest.mark.xfail(reason=MISSED[robot])) for robot in MISSED),
    ],
)
def test_every_command_answers(
    robot: str, contactlab: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = model_of(robot)
    for name in ("MIN_SECONDS", "MAX_SECONDS", "STEP_SECONDS"):
        # Most of the time would be spent on measuring it well.
        monkeypatch.setattr(timing, name, 1e-3)

    def ask(*arguments: str) -> None:
        start = time.perf_counter()
        code, out, err = contactlab(*arguments, "--workers", "0", "--format", "json")
        assert code in (0, 1), (arguments, err)
        data = json.loads(out)
        tell(robot, arguments[0], code, start, words(arguments[0], data))

    contactlab("init", str(model), "-o", "robot.yaml")
    text = (tmp_path / "robot.yaml").read_text()
    text = re.sub("duration: .*", f"duration: {SECONDS}", text).replace("seeds: 2", "seeds: 1")
    text = re.sub("\n  (cone|solref): .*", "", text.replace("\ndrive: hold", "\ndrive: exercise"))
    (tmp_path / "robot.yaml").write_text(text)
    start = time.perf_counter()
    code, _, err = contactlab("sweep", "robot.yaml", "-o", "sweep", "--workers", "0")
    assert code == 0, err
    labels = Counter(Store.open(tmp_path / "sweep").table["label"].to_pylist())
    verdict = ", ".join(f"{count} {label}" for label, count in labels.items())
    tell(robot, "sweep", code, start, verdict)
    ask("examine", str(model), "--section", "checks", "--set", f"duration={SECONDS}", "-o", "check")
    ask("examine", str(model), "--section", "labels", "-o", "labels")
    ask("effects", "robot.yaml", "--seeds", "1", "-o", "effects")
    ask("tradeoff", "robot.yaml", "-o", "tradeoff")
    still = [each for each in COMMANDS if not moved(tmp_path / each)]
    assert not still
