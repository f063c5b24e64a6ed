"""Give whole commands bent files of every kind, each in a process of its own.

Files are bent by the words of their own kind: names, numbers and lines change places, and hostile
ones are put in. python -m tests.attack.bent_commands COUNT SEED
"""

import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import chdir, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, NoReturn

import mujoco
from tests.attack.attack import MODEL, make_store
from tests.attack.mutations import redo
from tests.attack.readers import POLICY, SCENE

from contactlab.command_line.main import main as run_main
from contactlab.store.verify_store import write_baseline

SECONDS, BYTES = 60, 6 << 30
CODES = {0, 1, 2, 3, 4}
SWEEP = """
version: 1
scene: ./scene
duration: 0.02
seeds: 2
checks: flagged
axes:
  timestep: [1.0e-3, 2.0e-3]
  friction.slide: [0.1, 0.5, 1.0]
expect:
  - {where: {timestep: 1.0e-3}, label: stable, metrics: {penetration_max: {max: 1}}}
tolerances: {penetration_max: 1.0e-2}
exclude: [{timestep: 2.0e-3, friction.slide: 0.1}]
"""
URDF = """<?xml version="1.0"?>
<robot name="arm"><mujoco><compiler discardvisual="false"/></mujoco>
<link name="base"/><link name="tip"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size=".1 .2 .3"/></geometry></collision></link>
<joint name="hip" type="revolute"><parent link="base"/><child link="tip"/>
<origin xyz="0 0 1" rpy="0 .1 0"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="10" velocity="3"/><dynamics damping=".1" friction=".2"/></joint>
</robot>
"""
KEYED = MODEL.format(height=0.1).replace(
    "</mujoco>",
    '<keyframe><key name="low" qpos="0 0 .1 1 0 0 0 .1" ctrl="1"/>'
    '<key name="far" qpos="1 0 .2 1 0 0 0 0" qvel="0 0 0 0 0 0 .1"/></keyframe></mujoco>',
)
ADVISORIES = Path(__file__).parents[2] / "advisories"
RECORDED = SCENE.decode() + (
    "recording: {file: motion.csv, run: trial, units: {length: m, angle: rad, time: s}}\n"
)
PLUGIN = '''
from contactlab.plugin import metric

@metric(unit="m", better="lower")
def highest(context):
    """The highest place."""
    return context.trace.qpos[:, :, 2].max(axis=1)
'''
# Words that stand where others are expected.
HOSTILE = (
    *(
        "0",
        "-1",
        "1e308",
        "-1e-320",
        "nan",
        ".inf",
        "1e99999",
        "99999999999999999999",
        "0x10",
        "1_0",
    ),
    *(
        "~",
        "true",
        "[]",
        "{}",
        "[[]]",
        "{a: {b: [1]}}",
        '""',
        "''",
        "*x",
        "&x",
        "!!float x",
        "|",
        ">",
    ),
    *(
        "\x00",
        "\x85",
        "\ufeff",
        "\U0001f600",
        "\u202e",
        "a" * 5000,
        "../../etc/passwd",
        "/dev/stdin",
    ),
    *("<", "&#0;", "]]>", "<!--", "$HOME", "%s%n", "{0.__class__}", "1 2 3", "1,5", "2026-02-30"),
)
_WORD = re.compile(r"[^\s,:;{}\[\]<>=\"'()]+")


def _bend_text(text: str, chance: random.Random) -> str:  # noqa: PLR0911 - one for each way
    words = [*_WORD.finditer(text)]
    lines = text.splitlines(keepends=True)
    match chance.randrange(8):
        case 0:  # a hostile word
            word = chance.choice(words)
            return text[: word.start()] + chance.choice(HOSTILE) + text[word.end() :]
        case 1:  # two words change places
            first, last = sorted(chance.sample(words, 2), key=lambda word: word.start())
            between = text[first.end() : last.start()]
            return text[: first.start()] + last[0] + between + first[0] + text[last.end() :]
        case 2:  # a line again, elsewhere
            lines.insert(chance.randrange(len(lines)), chance.choice(lines))
            return "".join(lines)
        case 3:  # a part is missing
            start, end = sorted(chance.sample(range(len(text)), 2))
            return text[:start] + text[min(end, start + 40) :]
        case 4:  # a part many times
            start = chance.randrange(len(text))
            return (
                text[:start]
                + text[start : start + 30] * chance.choice((2, 50, 3000))
                + text[start:]
            )
        case 5:  # two words of one name
            word = chance.choice(words)[0]
            return text.replace(chance.choice(words)[0], word)
        case 6:  # numbers of another size
            factor = chance.choice(("e9", "e-9", "e300", "00000", ".5.5"))
            return re.sub(r"\d\b", lambda found: found[0] + factor * (chance.random() < 0.1), text)
        case _:  # other marks
            old, new = chance.sample("{}[]<>:\"',=", 2)
            return text.replace(old, new)


def _bend_bytes(data: bytes, chance: random.Random) -> bytes:
    start = chance.randrange(len(data))
    match chance.randrange(4):
        case 0:
            return data[:start]
        case 1:
            size = chance.choice((1, 4, 8))
            return (
                data[:start]
                + chance.choice((b"\xff", b"\0", b"\x7f")) * size
                + data[start + size :]
            )
        case 2:
            other = chance.randrange(len(data))
            return data[:start] + data[other : other + 64] + data[start:]
        case _:
            return data + data[start:]


class Kind(NamedTuple):
    """A file, and the commands that read it."""

    file: str
    sound: bytes
    commands: tuple[str, ...]
    seal: Callable[[], object] = lambda: None  # makes checksums right again


def _recording() -> bytes:
    names = ("x", "y", "z", "qw", "qx", "qy", "qz", "vx", "vy", "vz", "wx", "wy", "wz")
    lines = [",".join(["trial", "time", *(f"ball.{name}" for name in names)])]
    for trial in (1, 2):
        for step in range(12):
            height = 1 - 9.81 * (step / 100) ** 2 / 2
            values = [0, 0, height, 1, 0, 0, 0, *(0, 0, -9.81 * step / 100), *(0, 0, 0)]
            lines.append(",".join(map(repr, [trial, step / 100, *map(float, values)])))
    return ("\n".join(lines) + "\n").encode()


def make_kinds(folder: Path) -> dict[str, Kind]:
    """Write sound files of every kind into a folder, and return them by name."""
    store = make_store(folder / "made")
    write_baseline(store, folder / "base")
    for name, scene in {"scene": SCENE, "recorded": RECORDED.encode()}.items():
        (folder / name).mkdir()
        (folder / name / "scene.yaml").write_bytes(scene)
        (folder / name / "model.xml").write_text(
            MODEL.format(height=0.1)
            .replace("<body", '<body name="ball"', 1)
            .replace("<freejoint/>", '<freejoint name="ball"/>')
        )
    motion = _recording()
    (folder / "recorded" / "motion.csv").write_bytes(motion)
    compiled = mujoco.MjModel.from_xml_string(MODEL.format(height=0.1))
    mujoco.mj_saveModel(compiled, str(folder / "model.mjb"))
    trace = min(store.rglob("*.mcap"))
    keys = "version: 1\nscene: ./keyed.xml\nduration: 0.01\naxes: {keyframe: all}\n"
    (folder / "keys.yaml").write_text(keys)
    loaded = "version: 1\nscene: ./scene\nduration: 0.01\n"
    (folder / "real.yaml").write_text("version: 1\nscene: ./recorded\naxes: {recorded_run: all}\n")
    (folder / "driven.yaml").write_text(loaded + 'drive: {policy: "act.py:Push"}\n')
    (folder / "tabled.yaml").write_text(loaded + "drive: {file: controls.csv}\n")
    (folder / "plain.yaml").write_text(loaded)
    policy = (folder / "made" / "push.py").read_bytes()
    table = "time,push\n0,1\n0.004,-1\n0.008,0.5\n0.01,0\n"

    def seal() -> None:
        redo(store, 1)

    stored = ("verify made/store", "show made/store", "compare base made/store")
    sweeps = ("sweep {} --plan", "sweep {} -o out --workers 0 --limit 2")
    plain = "sweep plain.yaml -o out --workers 0 --plugin plug.py"
    kinds = {
        "sweep": Kind(
            "sweep.yaml", SWEEP.encode(), tuple(each.format("sweep.yaml") for each in sweeps)
        ),
        "scene": Kind("scene/scene.yaml", SCENE, ("list axes scene", "sweep plain.yaml --plan")),
        "model": Kind(
            "model.xml",
            MODEL.format(height=0.1).encode(),
            ("lint model.xml", "list axes model.xml"),
        ),
        "urdf": Kind("arm.urdf", URDF.encode(), ("lint arm.urdf", "list axes arm.urdf")),
        "compiled model": Kind(
            "model.mjb",
            (folder / "model.mjb").read_bytes(),
            ("lint model.mjb", "list axes model.mjb"),
        ),
        "keyframes": Kind(
            "keyed.xml", KEYED.encode(), tuple(each.format("keys.yaml") for each in sweeps)
        ),
        "recording": Kind(
            "recorded/motion.csv",
            motion,
            ("sweep real.yaml --plan", "sweep real.yaml -o out --workers 0"),
        ),
        "recorded scene": Kind(
            "recorded/scene.yaml", RECORDED.encode(), ("sweep real.yaml --plan",)
        ),
        "controls": Kind(
            "controls.csv", table.encode(), tuple(each.format("tabled.yaml") for each in sweeps)
        ),
        "policy": Kind("act.py", policy, ("sweep driven.yaml -o out --workers 0 --allow-code",)),
        "plug-in": Kind("plug.py", PLUGIN.encode(), (plain, "list metrics --plugin plug.py")),
        "advisory": Kind(
            "advisory.yaml",
            min(ADVISORIES.glob("CL-*.yaml")).read_bytes(),
            (f"advisories check advisory.yaml --mujoco {mujoco.__version__}",),
        ),
        "gates": Kind("gates.yaml", POLICY, ("compare base made/store --policy gates.yaml",)),
        "manifest": Kind(
            "made/store/manifest.json", (store / "manifest.json").read_bytes(), stored
        ),
        "baseline": Kind(
            "base/manifest.json",
            (folder / "base/manifest.json").read_bytes(),
            ("verify base", "compare base made/store"),
        ),
        "identity": Kind(
            "made/store/sweep.json", (store / "sweep.json").read_bytes(), stored, seal
        ),
        "table": Kind(
            "made/store/runs.parquet", (store / "runs.parquet").read_bytes(), stored, seal
        ),
        "trace": Kind(
            str(trace.relative_to(folder)),
            trace.read_bytes(),
            ("verify made/store", "compare base made/store --thorough"),
        ),
    }
    for kind in kinds.values():
        (folder / kind.file).write_bytes(kind.sound)
    return kinds


@dataclass(frozen=True)
class Case:
    """How a command ended on a bent file."""

    kind: str
    number: int
    command: str
    code: int
    seconds: float
    said: str

    @property
    def problem(self) -> str | None:
        """What is wrong with it."""
        if "Traceback (most recent call last)" in self.said:
            return "a traceback"
        if self.code not in CODES:
            return f"it ended with {self.code}"
        if self.seconds > SECONDS:
            return f"it took {self.seconds:.0f} s"
        if self.code in {2, 3} and "error" not in self.said:
            return "no word of the error"
        return None


def run_command(arguments: list[str], log: Path) -> tuple[int, float]:
    """Return exit code and time [s] of a command in a forked process; its output is in a file."""
    began = time.monotonic()
    if not (child := os.fork()):
        _be_command(arguments, log)
    status = -signal.SIGXCPU
    while time.monotonic() - began < SECONDS + 5:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status), time.monotonic() - began
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -9, time.monotonic() - began


def _be_command(arguments: list[str], log: Path) -> NoReturn:
    code = 70
    with suppress(BaseException):
        resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
        file = os.open(log, os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
        for number in (1, 2):
            os.dup2(file, number)
        # A test runner has put objects of its own in their places.
        sys.stdout, sys.stderr = (os.fdopen(number, "w", closefd=False) for number in (1, 2))
        sys.argv = ["contactlab", *arguments]
        try:
            run_main()
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else 71
        except BaseException:  # noqa: BLE001 - it counts as a traceback
            import traceback  # noqa: PLC0415 - rarely needed

            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def bend_files(folder: Path, count: int, seed: int) -> Iterator[Case]:
    """Bend files of all kinds in turn, and yield how each command ends on them."""
    with chdir(folder):
        kinds = make_kinds(folder)
        names = [*kinds]
        sealed = ("manifest.json", "runs.parquet", "sweep.json")
        before = {name: (folder / "made/store" / name).read_bytes() for name in sealed}
        for number in range(count):
            name = names[number % len(names)]
            kind, chance = kinds[name], random.Random(f"{seed} {number}")
            try:
                data = _bend_text(kind.sound.decode(), chance).encode()
            except UnicodeDecodeError:
                data = _bend_bytes(kind.sound, chance)
            (folder / kind.file).write_bytes(data)
            with suppress(Exception):  # such a file cannot be sealed
                kind.seal()
            for command in kind.commands:
                shutil.rmtree("out", ignore_errors=True)
                code, seconds = run_command(command.split(), folder / "log")
                said = (folder / "log").read_text(errors="replace")
                yield Case(name, number, command, code, seconds, said)
            (folder / kind.file).write_bytes(kind.sound)
            for file, content in before.items():
                (folder / "made/store" / file).write_bytes(content)


def main() -> None:
    """Print the cases with a problem, and how often each kind ended in which code."""
    count, seed = map(int, sys.argv[1:3])
    codes: dict[str, list[int]] = {}
    bad = 0
    with tempfile.TemporaryDirectory(prefix="contactlab-bent-") as name:
        for case in bend_files(Path(name), count, seed):
            codes.setdefault(case.kind, []).append(case.code)
            if case.problem:
                bad += 1
                print(f"{case.kind} {case.number}: {case.command}: {case.problem}")
                print(case.said[-1500:])
    for kind, found in codes.items():
        print(f"{kind:16} {' '.join(map(str, found))}")
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
