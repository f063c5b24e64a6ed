"""Writes all snapshots anew: python -m tests.snapshots, or make snapshots."""

from tests.snapshots.snapshots import write_snapshots

for path in write_snapshots():
    print(path)
