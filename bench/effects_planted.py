"""Useless parts that are put into models, and whether `contactlab effects` leaves them out.

Run: python -m bench.effects_planted FOLDER [FIRST LAST]

Each of five models gets four of the plants below. A model is clean if the smaller one takes at most
5 % more than the model without the plant, in plain loops of `mj_step` in turns.
"""

import sys
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
from bench.effects_truth import time_models

from contactlab.parts import register_parts
from contactlab.plan.task_options import read_task_options
from contactlab.studies.effects.effects_request import EffectsRequest
from contactlab.studies.effects.effects_study import study_effects
from contactlab.tasks.session import Session

MOST = 1.05
FRAME = """<mujoco><option timestep="0.002" {option}/><default><geom {geom}/></default><worldbody>
<geom name="floor" type="plane" size="9 9 .1" pos="0 0 -1"/>{bodies}{extra}</worldbody>
<contact>{contact}</contact><tendon>{tendons}</tendon><actuator>{actuators}</actuator>
<sensor>{sensors}</sensor></mujoco>"""
_LINK = """<body name="link{number}" pos="{x} 0 0"><joint name="hinge{number}" axis="0 1 0"
range="-2 2" limited="true" damping=".1"/><geom name="link{number}" type="capsule" size=".03"
fromto="0 0 0 .3 0 0" mass=".5"/><site name="site{number}" pos=".15 0 0"/>{inner}</body>"""


def build_chain(count: int) -> str:
    """Return a chain of links."""
    inner = ""
    for number in reversed(range(count)):
        inner = _LINK.format(number=number, x=0.3 if number else 0, inner=inner)
    return inner


def build_balls(count: int) -> str:
    """Return balls that fall onto the floor on slides, and turn."""
    return "".join(
        f'<body name="link{number}" pos="{number} 0 -.85"><joint name="hinge{number}" type="slide" '
        f'axis="0 0 1" range="-1 1" limited="true"/><joint axis="1 0 0" damping=".01"/><geom '
        f'name="link{number}" size=".1" mass="1"/><site name="site{number}"/></body>'
        for number in range(count)
    )


MODELS: dict[str, tuple[int, Callable[[int], str]]] = {
    "pendulum": (2, build_chain),
    "arm": (4, build_chain),
    "snake": (7, build_chain),
    "ball": (1, build_balls),
    "balls": (4, build_balls),
}
FAR = "".join(
    f'<geom name="far{number}" type="{kind}" size=".2 .2 .2" pos="{20 + number} {9 * place} 0"/>'
    for number, (kind, place) in enumerate(product(("box", "ellipsoid", "capsule"), range(5)))
)
FIELDS = ("option", "geom", "extra", "contact", "tendons", "sensors")
PLANTS = ("far geoms and sensors", "tendons", "condim 6 and fluid", "noslip")


def build_model(name: str, plant: str) -> str:
    """Return a model with a plant, or without one if it is empty."""
    count, build = MODELS[name]
    fill: dict[str, str] = dict.fromkeys(FIELDS, "")
    fill["bodies"] = build(count)
    fill["geom"] = 'condim="1"' if name.startswith("ball") or plant == "noslip" else 'condim="3"'
    fill["actuators"] = "".join(
        f'<motor name="motor{number}" joint="hinge{number}" ctrlrange="-1 1" gear="2"/>'
        for number in range(count)
    )
    if plant == PLANTS[0]:
        fill["extra"] = FAR
        fill["sensors"] = "".join(
            f'<framepos objtype="site" objname="site{number % count}"/><subtreecom body="link0"/>'
            f'<framelinacc objtype="site" objname="site{number % count}"/>'
            for number in range(30)
        )
    if plant == PLANTS[1]:
        fill["tendons"] = "".join(
            f'<spatial name="rope{number}"><site site="site{number % count}"/><site site="hook"/>'
            "</spatial>"
            for number in range(25)
        )
        fill["extra"] = '<site name="hook" pos="1 1 1"/>'
    if plant == PLANTS[2]:
        fill["option"] = 'density="1.2" viscosity="1.8e-5" cone="pyramidal"'
        fill["geom"] = 'condim="6" friction="1 0 0"'
    if plant == PLANTS[3]:
        fill["option"] = 'noslip_iterations="20"'
    return FRAME.format(**fill)


def build_original(name: str, plant: str) -> str:
    """Return the model that a plant is put into."""
    whole = build_model(name, "")
    if plant == PLANTS[2]:
        return whole.replace('condim="1"', 'condim="3" friction="1 0 0"', 1)
    return whole.replace('condim="3"', 'condim="1"', 1) if plant == PLANTS[3] else whole


def clean_model(folder: Path, name: str, plant: str) -> Iterator[str]:
    """Yield a line on a planted model: its time over that of the original, before and after."""
    folder = folder / f"{name}-{PLANTS.index(plant)}"
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "planted.xml"
    file.write_text(build_model(name, plant))
    task = read_task_options(duration="0.6s")
    request = EffectsRequest(str(file), task=task, max_cpu=300.0)
    report = study_effects(request, Session(folder / "out"))
    small = folder / "out" / report.smaller.file if report.smaller else file
    models = [
        mujoco.MjModel.from_xml_string(build_original(name, plant)),
        mujoco.MjModel.from_xml_path(str(file)),
        mujoco.MjModel.from_xml_path(str(small)),
    ]
    before, after = time_models(models)
    clean = after <= MOST
    word = "clean" if clean else "NOT CLEAN"
    kept = "; ".join(f"{part}: {reason}" for part, reason in report.kept.items())
    gone = ", ".join(report.smaller.left_out) if report.smaller else report.sentence
    yield f"{word:9} {name:9} {plant:22} x{before:.2f} -> x{after:.2f}  [{gone}] {kept}"


def main() -> None:
    """Plant all, and print which are clean."""
    register_parts()
    folder = Path(sys.argv[1])
    first, last = map(int, sys.argv[2:4] or (0, len(MODELS) * len(PLANTS)))
    clean = 0
    for name, plant in [*product(MODELS, PLANTS)][first:last]:
        for line in clean_model(folder, name, plant):
            clean += line.startswith("clean")
            print(line, flush=True)
    print(f"{clean} of {last - first} are clean")


if __name__ == "__main__":
    np.seterr(all="raise")
    main()
