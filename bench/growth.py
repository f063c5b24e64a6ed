"""Growth of CPU time in runs, steps, contacts and geoms, next to bare stepping, with a figure.

Run: python -m bench.growth [--part 1] [--rounds 3] [--only NAME] [-o build/growth.png]

Each point is a sweep of its own, without traces and checks, in one process: a whole command, less
the command's start with one short run. Bare stepping is `mj_step(model, data, n)`, after
compiling. Points take turns within each round. Each line has the median over the rounds, with the
least and the most, and the exponent of growth between the two largest sizes: 1 is linear.
`--part 10` measures a tenth of each size.
"""

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import altair as alt
import mujoco
from bench.processes import adopt_orphans, cpu_of

STEP = 0.002
SWEEP = """version: 1
scene: {scene}
axes: {{}}
trace: none
checks: none
timeout: 36000
duration: {duration}
seeds: {seeds}
"""


@dataclass(frozen=True)
class Point:
    """One sweep: a model as XML, runs, and steps of each."""

    xml: str
    runs: int
    steps: int


def balls(count: int, walls: int = 0) -> str:
    """Return a model of balls that lie apart on a floor, and of walls that nothing reaches."""
    side = math.ceil(math.sqrt(max(count, walls)))
    lying = (
        f'<body pos="{each % side} {each // side} .1"><freejoint/><geom size=".1"/></body>'
        for each in range(count)
    )
    standing = (
        f'<geom type="box" size=".1 .1 .1" pos="{each % side} {each // side} 9"/>'
        for each in range(walls)
    )
    return (
        f'<mujoco><option timestep="{STEP}"/><worldbody><geom type="plane" size="99 99 1"/>'
        f"{''.join(lying)}{''.join(standing)}</worldbody></mujoco>"
    )


SIZES: Mapping[str, tuple[Callable[[int], Point], tuple[int, ...]]] = {
    "runs": (lambda size: Point(balls(1), size, 10), (1000, 10_000, 100_000)),
    "steps": (lambda size: Point(balls(1), 1, size), (100_000, 1_000_000, 10_000_000)),
    "contacts": (lambda size: Point(balls(size), 1, 100), (20, 200, 2000)),
    "geoms": (lambda size: Point(balls(1, walls=size), 1, 100), (200, 2000, 20_000)),
}
"""Growing quantities: the sweep of a size, and the sizes."""


def sweep_seconds(point: Point, folder: Path) -> float:
    """Return the CPU time of the whole command [s]."""
    model = folder / "model.xml"
    model.write_text(point.xml, encoding="utf-8")
    duration = point.steps * STEP
    text = SWEEP.format(scene=model, duration=duration, seeds=point.runs)
    (folder / "sweep.yaml").write_text(text, encoding="utf-8")
    with tempfile.TemporaryDirectory(dir=folder) as store:
        program = str(Path(sys.executable).with_name("contactlab"))
        command = [program, "sweep", str(folder / "sweep.yaml"), "-o", f"{store}/store"]
        return cpu_of([*command, "--workers", "0"])


def stepping_seconds(point: Point) -> float:
    """Return the CPU time of the same steps alone [s]."""
    model = mujoco.MjModel.from_xml_string(point.xml)
    spent = 0.0
    for _ in range(point.runs):
        data = mujoco.MjData(model)
        begin = time.thread_time()
        mujoco.mj_step(model, data, point.steps)
        spent += time.thread_time() - begin
    return spent


def measure(name: str, part: int, rounds: int, folder: Path) -> list[dict[str, object]]:
    """Print a line for each size, and return its numbers as rows of the figure."""
    make, whole = SIZES[name]
    sizes = [size // part for size in whole]
    found: list[list[tuple[float, float]]] = [[] for _ in sizes]
    for _ in range(rounds):
        start = sweep_seconds(Point(balls(1), 1, 10), folder)
        for size, taken in zip(sizes, found, strict=True):
            point = make(size)
            taken.append((sweep_seconds(point, folder) - start, stepping_seconds(point)))
    lines, medians = list[dict[str, object]](), list[tuple[float, float]]()
    for size, taken in zip(sizes, found, strict=True):
        medians.append((median(one for one, _ in taken), median(bare for _, bare in taken)))
        least, most = min(one for one, _ in taken), max(one for one, _ in taken)
        sweep, bare = medians[-1]
        print(
            f"{name:9}{size:>12,}  sweep {sweep:8.3f} s ({least:.3f}..{most:.3f})"
            f"  stepping {bare:8.3f} s  ratio {sweep / bare:6.2f}",
            flush=True,
        )
        # Some sizes take less than the noise of a command's start.
        for kind, seconds in zip(("sweep", "bare stepping"), medians[-1], strict=True):
            if seconds > 0:
                lines.append({"axis": name, "size": size, "seconds": seconds, "of": kind})
    (low, bare_low), (high, bare_high) = medians[-2:]
    ratio = math.log(sizes[-1] / sizes[-2])
    if min(low, bare_low) > 0:
        exponents = math.log(high / low) / ratio, math.log(bare_high / bare_low) / ratio
        print(f"{name:9} grows with exponent {exponents[0]:.2f}, stepping {exponents[1]:.2f}")
    return lines


def draw(lines: list[dict[str, object]], output: Path) -> None:
    """Write the figure: a panel for each axis, both scales logarithmic."""
    output.parent.mkdir(parents=True, exist_ok=True)
    chart = (
        alt.Chart(alt.Data(values=lines))
        .mark_line(point=True)
        .encode(
            x=alt.X("size:Q", scale=alt.Scale(type="log"), title=None),
            y=alt.Y("seconds:Q", scale=alt.Scale(type="log"), title="CPU time [s]"),
            color=alt.Color("of:N", title=None),
        )
        .properties(width=220, height=180)
        .facet(
            alt.Facet("axis:N", title=None),
            columns=2,
            title="CPU time of a sweep and of its steps alone",
        )
        .resolve_scale(x="independent", y="independent")
    )
    chart.save(str(output), scale_factor=2)
    print(output)


def main() -> None:
    """Measure each axis, then draw."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--part", type=int, default=1)
    options.add_argument("--rounds", type=int, default=3)
    options.add_argument("--only", action="append", choices=[*SIZES])
    options.add_argument("-o", "--output", type=Path, default=Path("build/growth.png"))
    asked = options.parse_args()
    adopt_orphans()
    lines = list[dict[str, object]]()
    with tempfile.TemporaryDirectory(prefix="contactlab-bench-") as folder:
        for name in asked.only or SIZES:
            lines += measure(name, asked.part, asked.rounds, Path(folder))
    draw(lines, asked.output)


if __name__ == "__main__":
    main()
