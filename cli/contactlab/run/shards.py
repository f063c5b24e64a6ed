"""A shard: every so many-th run of a sweep, in a store of its own that can be merged."""

import re

from contactlab.errors import SweepFileError
from contactlab.run.planned_runs import RunIndex
from contactlab.schema.evidence import SweepIdentity, WholeGrid
from contactlab.schema.sweep_schema import Sweep

_SHARD = re.compile(r"([0-9]{1,9})/([0-9]{1,9})")
# What a run's part in depends on others, which a shard does not know.
_OF_ALL_RUNS = ("refine", "until", "search", "accuracy", "timing")


def parse_shard(text: str) -> tuple[int, int]:
    """Return which shard of how many is meant, as by 3/64; a SweepFileError says what to write."""
    found = _SHARD.fullmatch(text)
    number, shards = map(int, found.groups()) if found else (0, 0)
    if not 1 <= number <= shards:
        raise SweepFileError(f"--shard {text}: write N/M, such as 3/64; N counts from 1 to M")
    return number, shards


def shard_of_sweep(
    shard: tuple[int, int], sweep: Sweep, whole: RunIndex, identity: SweepIdentity
) -> tuple[RunIndex, SweepIdentity]:
    """Return the runs of a shard, and the identity of a store of those.

    Raises a SweepFileError if what the sweep asks for depends on all of its runs, or the shard has
    none.
    """
    number, shards = shard
    if asked := [name for name in _OF_ALL_RUNS if getattr(sweep, name)]:
        raise SweepFileError(
            f"a sweep with `{asked[0]}` has no shards: what it asks for depends on all runs; leave "
            "out --shard, or take the key out and merge shards of the whole grid"
        )
    if number > len(whole):
        raise SweepFileError(
            f"shard {number}/{shards} has no runs: the sweep has {len(whole):,}; write at most as "
            "many shards"
        )
    part = whole.shard(number, shards)
    return part, part_of(whole, part, identity, f"{number}/{shards}")


def part_of(
    whole: RunIndex, part: RunIndex, identity: SweepIdentity, shard: str | None = None
) -> SweepIdentity:
    """Return the identity of a store of a part of a grid's runs, which may be a shard."""
    own = {"runs_asked": len(part), "whole": WholeGrid(shard=shard, runs=len(whole))}
    return identity.model_copy(update=own)
