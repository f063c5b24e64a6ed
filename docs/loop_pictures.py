"""Draw docs/pictures/loop-border.svg: runs of a hinge under a PD, and the border of its poles.

Run: python -m docs.loop_pictures
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import altair as alt
import numpy as np

import contactlab
from contactlab.charts import save_figure

INERTIA, KP, KD, STEP = 1e-3, 8.0, 0.4, 5e-4
HINGE = f"""<mujoco><option timestep="{STEP}" gravity="0 0 0"/><worldbody><body>
<joint name="hinge" axis="0 1 0"/><geom size=".01" contype="0" conaffinity="0"/>
<inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/></body></worldbody>
<actuator><motor joint="hinge"/></actuator></mujoco>"""
PERIODS = (2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30)  # in steps
PANELS = {
    "dof_armature[hinge]": ("armature [g m²]", 1e3, np.arange(0, 3e-3, 2.5e-4)),
    "drive.latency": ("delay [ms]", 1e3, np.arange(0, 6.1e-3, 5e-4)),
}


def find_pole(period: int, armature: float, delay: float) -> float:
    """Return the magnitude of the largest discrete pole, of the recursion over a period."""
    late, part = divmod(round(delay / STEP), period)
    state = np.eye(3 + late)  # x, v, the acting torque, and the waiting ones
    ask = np.zeros(3 + late)
    ask[:2] = -KP, -KD
    queue = [*state[3:], ask]
    x, v, torque = state[:3]
    for step in range(period):
        torque = queue.pop(0) if step == part else torque
        v = v + STEP / (INERTIA + armature) * torque
        x = x + STEP * v
    return float(np.abs(np.linalg.eigvals(np.array([x, v, torque, *queue]))).max())


def run_panel(axis: str, folder: Path) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """Return points of runs, and the border of the poles at each rate."""
    _, unit, values = PANELS[axis]
    sweep = {
        "version": 1,
        "scene": str(folder / "hinge.xml"),
        "drive": {"kp": KP, "kd": KD, "rate": 1 / (PERIODS[0] * STEP)},
        "axes": {"drive.rate": [1 / (each * STEP) for each in PERIODS], axis: values.tolist()},
        "duration": 2.0,
        "checks": "none",
    }
    store = contactlab.sweep(sweep, output=folder / axis.partition("[")[0], workers=0)
    points = list[dict[str, object]]()
    for record in store.records():
        speed = np.abs(store.trace(record).qvel[:, 0])
        fifth = len(speed) // 5
        grows = record.status != "ok" or speed[-fifth:].max() > speed[fifth : 2 * fifth].max()
        value = float(record.axes[axis])
        points.append(
            {
                "rate": record.axes["drive.rate"],
                "value": unit * value,
                "run": "grows" if grows else "shrinks",
            }
        )
    # Delays are whole steps, and a short one may help: the border has an upper and a lower side.
    armed, lines = axis.startswith("dof"), list[dict[str, object]]()
    grid = np.arange(0, 2 * float(values[-1]), STEP / (1 if not armed else 100))
    for period in PERIODS:
        held = [find_pole(period, each * armed, each * (not armed)) < 1 for each in grid]
        for place in np.flatnonzero(np.diff(held)):
            side = "upper" if held[place] else "lower"
            value = unit * float(grid[place : place + 2].mean())
            lines.append({"rate": 1 / (period * STEP), "value": value, "side": side})
    return points, lines


def main() -> None:
    """Draw both panels, and print on how many of the runs the poles agree."""
    panels = list[alt.LayerChart]()
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hinge.xml").write_text(HINGE, encoding="utf-8")
        for axis, (title, unit, values) in PANELS.items():
            points, lines = run_panel(axis, folder)
            right = 0
            for point in points:
                period = round(1 / (float(str(point["rate"])) * STEP))
                value = float(str(point["value"])) / unit
                armed = axis.startswith("dof")
                pole = find_pole(period, value * armed, value * (not armed))
                right += (pole > 1) == (point["run"] == "grows")
            sys.stdout.write(f"{axis}: {right} of {len(points)} runs on their side of the border\n")
            x = alt.X("rate:Q", title="rate [Hz]", scale=alt.Scale(type="log", nice=False))
            y = alt.Y(
                "value:Q",
                title=title,
                scale=alt.Scale(domain=[0, unit * values[-1] * 1.05], clamp=True),
            )
            colours = alt.Scale(domain=["shrinks", "grows"], range=["#4878a8", "#d1603d"])
            dots = (
                alt.Chart(alt.Data(values=points))
                .mark_circle(size=28)
                .encode(x, y, alt.Color("run:N", scale=colours, title="offset"))
            )
            border = (
                alt.Chart(alt.Data(values=lines))
                .mark_line(color="black", clip=True)
                .encode(x, y, alt.Detail("side:N"))
            )
            panels.append(alt.layer(dots, border).properties(width=260, height=200))
    save_figure(alt.hconcat(*panels), Path(__file__).parent / "pictures" / "loop-border.svg")


if __name__ == "__main__":
    main()
