"""Shards: every n-th run of a sweep, in a separate store that can be merged."""

import re

from contactlab.errors import SweepFileError
from contactlab.run.planned_runs import RunIndex
from contactlab.schema.evidence import SweepIdentity, WholeGrid
from contactlab.schema.sweep_schema import Sweep

_SHARD_TEXT = re.compile(r"([0-9]{1,9})/([0-9]{1,9})")
# Keys with results that depend on runs of other shards.
_KEYS_OF_ALL_RUNS = ("refine", "until", "search", "accuracy", "timing")


def parse_shard(text: str) -> tuple[int, int]:
    """Return number and count of shards from text such as 3/64. Raises a SweepFileError."""
    match = _SHARD_TEXT.fullmatch(text)
    number, shards = map(int, match.groups()) if match else (0, 0)
    if not 1 <= number <= shards:
        raise SweepFileError(f"--shard {text}: write N/M, such as 3/64; N counts from 1 to M")
    return number, shards


def shard_of_sweep(
    shard: tuple[int, int], sweep: Sweep, whole: RunIndex, identity: SweepIdentity
) -> tuple[RunIndex, SweepIdentity]:
    """Return the runs of a shard, and the identity of a store of them.

    Raises a SweepFileError if the sweep has a key that depends on all of its runs, or the shard has
    no runs.
    """
    number, shards = shard
    if keys := [name for name in _KEYS_OF_ALL_RUNS if getattr(sweep, name)]:
        raise SweepFileError(
            f"a sweep with `{keys[0]}` has no shards, because this key depends on all runs; "
            "remove --shard, or remove the key and merge shards of the whole grid"
        )
    if number > len(whole):
        raise SweepFileError(
            f"shard {number}/{shards} has no runs: the sweep has {len(whole):,}; write at most as "
            "many shards"
        )
    part = whole.select_shard(number, shards)
    return part, part_of(whole, part, identity, f"{number}/{shards}")


def part_of(
    whole: RunIndex, part: RunIndex, identity: SweepIdentity, shard: str | None = None
) -> SweepIdentity:
    """Return the identity of a store with a part of a grid's runs, which may be a shard."""
    own = {"runs_asked": len(part), "whole": WholeGrid(shard=shard, runs=len(whole))}
    return identity.model_copy(update=own)
