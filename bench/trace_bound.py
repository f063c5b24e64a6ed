"""The least that traces cost: their bytes compressed, hashed and written, next to bare stepping.

Run: python -m bench.trace_bound [--rounds 5] [--case NAME]

Each case is a small sweep of `bench.overhead` that keeps all traces. Its stored chunks are unpacked
first. Each round then steps the runs without recording, compresses all chunks again, hashes the
files (SHA-256 and CRC-32), and writes them. The shares are medians of the rounds, of the time of
the steps. A sweep with traces that only did this would cost one more than their sum.
"""

import argparse
import hashlib
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from statistics import median

import mujoco
import numpy as np
from bench.cases import CASES, Case
from bench.plain import PlainRun
from bench.processes import cpu_of
from bench.reading_contacts import write_columns
from bench.runs import plain_runs

from contactlab.store.mcap.encode_buffers import SCRATCH
from contactlab.store.mcap.file_parts import CHUNK_HEAD
from contactlab.store.mcap.stored_messages import read_summary, unpack_chunk


def contents_of(file: bytes) -> list[bytes]:
    """Return the unpacked chunks of a trace."""
    chunks = list[bytes]()
    for entry in read_summary(file).chunks:
        start = entry.start + CHUNK_HEAD.size
        content = np.empty(entry.unpacked_size, np.uint8)
        unpack_chunk(memoryview(file)[start : start + entry.size], content)
        chunks.append(content.tobytes())
    return chunks


def step_runs(runs: list[PlainRun]) -> float:
    """Return the CPU time of bare steps [s], without compiling."""
    seconds = 0.0
    for run in runs:
        model, data = run.start()
        begin = time.process_time()
        mujoco.mj_step(model, data, run.steps)
        seconds += time.process_time() - begin
    return seconds


def seconds_of(work: Callable[[], object]) -> float:
    """Return the CPU time of some work [s]."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def measure_case(case: Case, rounds: int, folder: Path) -> None:
    """Print the shares of one case."""
    sweep, store = folder / "sweep.yaml", folder / "store"
    write_columns(folder / "columns")
    sweep.write_text(f"{case.sweep}seeds: {case.seeds[1]}\n", encoding="utf-8")
    program = str(Path(sys.executable).with_name("contactlab"))
    cpu_of([program, "sweep", str(sweep), "-o", str(store), "--workers", "0"])
    runs = plain_runs(sweep)
    files = [path.read_bytes() for path in sorted(store.rglob("*.mcap"))]
    chunks = [chunk for file in files for chunk in contents_of(file)]
    work: dict[str, Callable[[], object]] = {
        "compress": lambda: [SCRATCH.compressor.compress(chunk) for chunk in chunks],
        "hash": lambda: [(hashlib.sha256(file).digest(), zlib.crc32(file)) for file in files],
        "write": lambda: [(folder / f"{n}.mcap").write_bytes(f) for n, f in enumerate(files)],
    }
    shares: dict[str, list[float]] = {name: [] for name in work}
    for _ in range(rounds):
        steps = step_runs(runs)
        for name, part in work.items():
            shares[name].append(seconds_of(part) / steps)
    content, stored = (sum(map(len, each)) / len(runs) / 1e6 for each in (chunks, files))
    parts = ", ".join(f"{name} {median(each):.2f}" for name, each in shares.items())
    least = 1 + sum(median(each) for each in shares.values())
    print(
        f"{case.name}: {content:.2f} MB a run, {stored:.2f} MB stored; {parts}; least {least:.2f}"
    )


def main() -> None:
    """Measure each case."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--rounds", type=int, default=5)
    options.add_argument("--case", action="append", choices=[case.name for case in CASES])
    request = options.parse_args()
    for case in CASES:
        if case.name not in (request.case or [case.name]):
            continue
        with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
            measure_case(case, request.rounds, Path(folder))


if __name__ == "__main__":
    main()
