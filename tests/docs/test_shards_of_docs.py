"""The files of examples/clusters for array jobs: each starts every shard once, and merges all."""

import os
import re
import shlex
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML
from tests.docs.tried_commands import parse

ROOT = Path(__file__).parents[2]
CLUSTERS = ROOT / "examples/clusters"
PAGE = (ROOT / "docs/how-to/clusters.md").read_text(encoding="utf-8")
(PLAIN,) = re.findall(r"## Shards\n.*?```sh\n(.*?)```", PAGE, re.DOTALL)
SLURM, PARALLEL = (
    (CLUSTERS / name).read_text(encoding="utf-8")
    for name in ("shards.sbatch", "shards-parallel.sh")
)
JOB, WORKFLOW = (
    YAML(typ="safe").load(CLUSTERS / name) for name in ("shards-job.yaml", "shards-workflow.yaml")
)
# Stands in for the command: notes how it was called, and leaves the store that it was told of.
COMMAND = """#!/bin/sh
echo "$0 $*" >> "$CALLS"
while [ $# -gt 1 ]; do [ "$1" = -o ] && mkdir -p "$2"; shift; done
"""
# As GNU parallel does: the words with each line of the input in place of {}.
IN_PARALLEL = r"""#!/bin/sh
while [ "${1#--}" != "$1" ]; do shift 2; done
while read -r line; do
  for word in "$@"; do printf '%s\n' "$word" | sed "s/{}/$line/g"; done | xargs -d '\n' env
done
"""


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with stand-ins for commands."""
    for name, text in (("contactlab", COMMAND), ("parallel", IN_PARALLEL)):
        script = tmp_path / "bin" / name
        script.parent.mkdir(exist_ok=True)
        script.write_text(text)
        script.chmod(0o755)
    return tmp_path


def calls(place: Path, command: list[str], **variables: object) -> list[list[str]]:
    """Run a command, and return the words of each call of contactlab, which all are understood."""
    log = place / "calls"
    log.unlink(missing_ok=True)
    environment = {name: str(value) for name, value in variables.items()}
    path = f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(
        command, cwd=place, env={"PATH": path, "CALLS": str(log), **environment}, check=True
    )
    found = [["contactlab", *shlex.split(line)[1:]] for line in log.read_text().splitlines()]
    for words in (found[0], found[-1]):
        parse(shlex.join(words))
    return found


def told(words: list[str], option: str) -> str:
    return words[words.index(option) + 1]


def check_shards(found: list[list[str]], count: int, numbers: Sequence[int] = ()) -> None:
    """Check that each shard, or each of some, is swept once, to a place of its own."""
    wanted = numbers or range(1, count + 1)
    assert [told(words, "--shard") for words in found] == [f"{number}/{count}" for number in wanted]
    assert len({told(words, "-o") for words in found}) == len(wanted)


def check_merge(words: list[str], count: int) -> None:
    assert words[1] == "sweep"
    assert len(words[2 : words.index("--merge")]) == count


def test_two_shards(place: Path) -> None:
    *shards, merge = calls(place, ["sh", "-ec", PLAIN])
    check_shards(shards, 2)
    check_merge(merge, 2)


def test_a_slurm_array(place: Path) -> None:
    first, last = re.findall(r"--array=(\d+)-(\d+)", SLURM)[0]
    assert first == "1"
    found = list[list[str]]()
    tasks = [1, 2, int(last)]
    for task in tasks:
        found += calls(
            place,
            ["bash", "-ec", SLURM],
            SLURM_ARRAY_TASK_ID=task,
            SLURM_ARRAY_TASK_COUNT=last,
            SLURM_CPUS_PER_TASK=8,
            SHARDS=place / "shards",
        )
    check_shards(found, int(last), tasks)
    merge = re.findall("then: (contactlab sweep .*)", SLURM)[0].replace("/shared/robot", "shards")
    check_merge(calls(place, ["sh", "-ec", merge])[0], len(tasks))


def test_a_terminated_array_task_ends_its_sweep(place: Path) -> None:
    """The batch system's SIGTERM goes to the shell alone."""
    (place / "bin" / "contactlab").write_text(
        "#!/bin/bash\ntrap 'echo ended > \"$CALLS\"; exit 130' TERM\n"
        "kill -TERM $PPID\nfor turn in {1..200}; do sleep .05; done\n"
    )
    path = f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"
    variables = {"PATH": path, "CALLS": str(place / "calls"), "SHARDS": str(place)}
    done = subprocess.run(["bash", "-c", SLURM], cwd=place, env=variables, check=False)
    assert (place / "calls").read_text() == "ended\n"
    assert done.returncode in {130, 143}


def test_an_indexed_job(place: Path) -> None:
    spec: Mapping[str, Any] = JOB["spec"]
    assert spec["completionMode"] == "Indexed"
    container = spec["template"]["spec"]["containers"][0]
    given = {entry["name"]: entry["value"] for entry in container["env"]}
    assert given["SHARDS"].startswith("s3://")
    found = list[list[str]]()
    last = spec["completions"]
    for index in (0, 1, last - 1):
        command = [*container["command"], *container["args"]]
        shards = place / "shards"
        found += calls(place, command, JOB_COMPLETION_INDEX=index, SHARDS=shards)
    check_shards(found, last, [1, 2, last])


def test_a_matrix_of_github(place: Path) -> None:
    shard, merge = WORKFLOW["jobs"]["shard"], WORKFLOW["jobs"]["merge"]
    (sweep,) = (step["run"] for step in shard["steps"] if "--shard" in step.get("run", ""))
    numbers = shard["strategy"]["matrix"]["shard"]
    found = [calls(place, ["sh", "-ec", sweep], SHARD=number)[0] for number in numbers]
    check_shards(found, len(numbers))
    joined = next(step["run"] for step in merge["steps"] if "--merge" in step.get("run", ""))
    check_merge(calls(place, ["sh", "-ec", joined])[0], len(numbers))
    assert merge["needs"] == "shard"


def test_gnu_parallel(place: Path) -> None:
    *shards, merge = calls(place, ["sh", "-ec", PARALLEL])
    check_shards(shards, 64)
    check_merge(merge, 64)
