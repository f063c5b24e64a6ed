"""Results that cannot be written end a sweep with one clear line, and it can go on later."""

import re
from pathlib import Path
from typing import Any

import pytest

from contactlab.errors import OutputError, StoreError
from contactlab.store.verify_store import find_problems

# Python runs this before anything else; workers inherit the limit. Bytecode that is written under
# it would be torn.
LIMIT = """
import resource, sys
sys.dont_write_bytecode = True
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
"""


@pytest.mark.night
@pytest.mark.parametrize(
    "limited",
    [
        (20_000, r"traces/\w\w/\w{16}\.mcap"),
        (40_000, r"journal\.jsonl"),
        (120_000, r"runs\.parquet"),
    ],
)
@pytest.mark.parametrize("workers", ["0", pytest.param("2", marks=pytest.mark.night)])
def test_files_that_cannot_grow(
    command: Any, sweeper: Any, ball: str, tmp_path: Path, limited: tuple[int, str], workers: str
) -> None:
    size, file = limited
    (tmp_path / "small.yaml").write_text(ball)
    (tmp_path / "sitecustomize.py").write_text(LIMIT.format(size=size))
    sweep = ("sweep", "small.yaml", "-o", "store", "--workers", workers)
    code, out, err = command.run(*sweep, first=tmp_path)
    assert (code, out) == (2, "")
    assert re.fullmatch(rf"error: cannot write (/.*/)?store/{file}: File too large; .*\n", err)
    assert not list((tmp_path / "store").rglob("*.tmp"))
    sweeper.run(ball)
    assert find_problems(tmp_path / "store") == []
    sweeper.run(ball, "quiet")
    assert sweeper.outcome()[0]["trajectory_hash"] == sweeper.outcome("quiet")[0]["trajectory_hash"]


def test_another_sweep_in_the_folder(sweeper: Any, ball: str, stack: str) -> None:
    sweeper.run(ball)
    before = sweeper.outcome()
    with pytest.raises(StoreError, match="holds another sweep"):
        sweeper.run(stack)
    assert sweeper.outcome() == before


def test_the_same_folder_twice_at_once(sweeper: Any, ball: str) -> None:
    def again(_: object) -> None:
        sweeper.run(ball)

    with pytest.raises(OutputError, match="in use by another sweep"):
        sweeper.run(ball, progress=again)
