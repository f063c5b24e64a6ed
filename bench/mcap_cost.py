"""What a message costs: our writer, of both forms, against the mcap package's writer with JSON.

Run: python bench/mcap_cost.py [repeats]

Two made-up runs of 1500 steps are written, a ball that bounces (nq 7, one pair, 90 contacts) and a
stack of five boxes (nq 35, five pairs of four contacts, always touching). The writers take turns
in one process; figures are medians of process CPU time, and the ratios are the firm part.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from mcap.writer import Writer

from contactlab.contact.trace_arrays import (
    FOUND,
    POINT_FIELDS,
    SLOT_WIDTH,
    STICK,
    Floats,
    PairSeries,
    PairTrace,
    Trace,
)
from contactlab.store.mcap.trace_reader import read_trace
from contactlab.store.mcap.trace_writer import TraceEncoder

STEPS = 1500
TIMESTEP = 0.002
RNG = np.random.default_rng(0)
EXTRAS = b'{"run_id": "bench"}', {"seed": "0"}, b"<mujoco/>"

STEP_ARRAYS = (
    "kinetic",
    "potential",
    "contacts",
    "least_distance",
    "iterations",
    "iterations_most",
)
NET_ARRAYS = ("contacts", "mode", "normal", "tangential", "usage", "slip", "distance")

Case = tuple[Trace, list[PairSeries]]


def values(*shape: int) -> Floats:
    """Return (1, *shape) smooth numbers with noise in the last digits, as a solver leaves."""
    wave = np.sin(np.arange(shape[0]) * TIMESTEP)[None, :, None]
    return wave + 1e-9 * RNG.standard_normal((1, *shape))


def made_up(bodies: int, moving: int, pairs: int, slots: int, touching_every: int) -> Case:
    """Return a run.

    Args:
        bodies: number of free bodies.
        moving: how many coordinates of each change; a falling ball has one.
        pairs: contact pairs.
        slots: contact slots of each, all of which touch at once.
        touching_every: steps from one touch to the next.
    """

    def coordinates(width: int) -> Floats:
        still = np.arange(width * bodies) % width >= moving
        return np.where(still, 1.0, values(STEPS + 1, width * bodies))

    net, ones = values(STEPS, 1)[..., 0], np.ones((1, STEPS), np.int32)
    cases = [made_up_pair(f"floor-body{each}", slots, touching_every) for each in range(pairs)]
    trace = Trace(
        timestep=np.array([TIMESTEP]),
        steps_asked=STEPS,
        time=np.arange(STEPS + 1, dtype=np.float64)[None] * TIMESTEP,
        qpos=coordinates(7),
        qvel=coordinates(6),
        kinetic=net,
        potential=net,
        contacts=ones,
        least_distance=net,
        iterations=ones,
        iterations_most=ones,
        momentum=None,
        angular_momentum=None,
        pairs=tuple(pair for pair, _ in cases),
        warnings=({},),
    )
    return trace, [series for _, series in cases]


def made_up_pair(name: str, slots: int, touching_every: int) -> tuple[PairTrace, PairSeries]:
    """Return one pair that touches in one step of so many."""
    net = values(STEPS, 1)[..., 0]
    touching = np.arange(STEPS) % touching_every == 0
    contents = values(STEPS, slots * SLOT_WIDTH).reshape(1, STEPS, slots, SLOT_WIDTH)
    contents[..., FOUND] = np.where(touching, slots, 0)[None, :, None]
    mode = np.where(touching, STICK, 0)[None].astype(np.int8)
    counts = (touching * slots)[None].astype(np.int32)
    series = PairSeries(name, counts, net, net, net, net, net, mode)
    return PairTrace(name, contents, np.ones((1, 5))), series


def write_json(path: Path, trace: Trace, series: list[PairSeries]) -> None:
    """Write the same numbers as JSON, one message after the other."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Any", "jsonschema", b'{"type": "object"}')
        topics = ["/state", *(f"/contacts/{pair.name}" for pair in trace.pairs)]
        channels = [writer.register_channel(topic, "json", schema) for topic in topics]
        for row in range(trace.steps):
            log_time = round(float(trace.time[0, row]) * 1e9)
            for channel, message in zip(channels, messages(trace, series, row), strict=True):
                if message is not None:
                    data = json.dumps(message).encode()
                    writer.add_message(channel, log_time, data, log_time)
        writer.finish()


def messages(trace: Trace, series: list[PairSeries], row: int) -> list[dict[str, object] | None]:
    """Return one step's messages, None where a pair does not touch."""
    state: dict[str, object] = {
        name: getattr(trace, name)[0, row].tolist()
        for name in ("time", "qpos", "qvel", *STEP_ARRAYS)
    }
    found: list[dict[str, object] | None] = [state]
    for pair, net in zip(trace.pairs, series, strict=True):
        slots = pair.slots[0, row]
        points = [point(slot) for slot in slots[slots[:, FOUND] > 0]]
        totals = {name: getattr(net, name)[0, row].tolist() for name in NET_ARRAYS}
        found.append({**totals, "points": points} if points else None)
    return found


def point(slot: Floats) -> dict[str, object]:
    """Return one contact point's message."""
    return {name: slot[columns].tolist() for name, columns in POINT_FIELDS.items()}


def cpu(action: Callable[[], object]) -> float:
    """Return the CPU time of an action [ms]."""
    start = time.process_time()
    action()
    return (time.process_time() - start) * 1e3


def compare(name: str, case: Case, repeats: int, folder: Path) -> None:
    """Print what one run costs each way."""
    trace, series = case
    ours, theirs, small = (folder / f"{name}{kind}" for kind in (".mcap", ".json.mcap", ".blocks"))
    content, counts = TraceEncoder(trace, series).encode_run(0, *EXTRAS)
    blocks, _ = TraceEncoder(trace, series).encode_run(0, *EXTRAS, form="compact")
    rounds = [
        (
            cpu(lambda: ours.write_bytes(TraceEncoder(trace, series).encode_run(0, *EXTRAS)[0])),
            cpu(lambda: write_json(theirs, trace, series)),
            cpu(lambda: read_trace(ours)),
            cpu(
                lambda: small.write_bytes(
                    TraceEncoder(trace, series).encode_run(0, *EXTRAS, form="compact")[0]
                )
            ),
            cpu(lambda: read_trace(small)),
        )
        for _ in range(repeats)
    ]
    write, loop, read, write_blocks, read_blocks = (
        median(column) for column in zip(*rounds, strict=True)
    )
    points = sum(int(pair.touching.sum()) for pair in trace.pairs)
    count = sum(counts.values())
    share = len(content) / theirs.stat().st_size
    print(f"{name}: {count} messages, {points} contact points, {len(content) / 1e3:.0f} kB")
    print(f"  ours       {write:8.2f} ms  {write / count * 1e3:6.2f} us a message")
    print(f"  mcap, JSON {loop:8.2f} ms  {loop / count * 1e3:6.2f} us a message")
    print(f"  ratio      {loop / write:8.1f} x   {share:.2f} of the size; read in {read:.2f} ms")
    print(
        f"  compact    {write_blocks:8.2f} ms  {len(blocks) / 1e3:.0f} kB; "
        f"read in {read_blocks:.2f} ms"
    )


def main() -> None:
    """Compare on both runs."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    ball = made_up(bodies=1, moving=1, pairs=1, slots=1, touching_every=17)
    stack = made_up(bodies=5, moving=7, pairs=5, slots=4, touching_every=1)
    with tempfile.TemporaryDirectory() as folder:
        compare("ball", ball, repeats, Path(folder))
        compare("stack", stack, repeats, Path(folder))


if __name__ == "__main__":
    main()
