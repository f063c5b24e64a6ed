"""What `tune` reaches without contact, beside a hand: a forward error of 10 um at the end of 1.5 s.

Run: python -m bench.tune_hand FOLDER

The hand tries four integrators at 150 steps, Newton's solver, dense matrices, without contacts and
islands, and takes the cheapest that keeps the error. Both run in plain MuJoCo, in turns.
"""

import copy
import sys
import time
from pathlib import Path
from statistics import median

import mujoco
import numpy as np

from contactlab.parts import register_parts
from contactlab.plan.task_options import read_task_options
from contactlab.schema.tune_report import REPORT
from contactlab.studies.search.tune_request import TuneRequest
from contactlab.studies.search.tuning import tune_model
from contactlab.tasks.session import Session

LENGTH, LIMIT, TURNS, STEPS = 1.5, 1e-5, 25, 3000
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
_HEAD = '<default><geom contype="0" conaffinity="0"/></default><worldbody>'
_LINK = '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/>'
_HINGE = '<joint axis="0 1 0" damping=".01"/>'
CASES = {
    "chain": f"""<mujoco><option timestep="0.001"/>{_HEAD}
<body pos="0 0 2" euler="0 70 0">{_HINGE}{_LINK}
<body pos="0 0 -.3">{_HINGE}{_LINK}
<body pos="0 0 -.3">{_HINGE}{_LINK}<site name="tip" pos="0 0 -.3"/></body></body></body>
</worldbody></mujoco>""",
    "cart": f"""<mujoco><option timestep="0.002" integrator="implicitfast"/>{_HEAD}
<body pos="0 0 1"><joint type="slide" axis="1 0 0" damping=".3"/>
<geom type="box" size=".1 .05 .05" mass="1"/>
<body euler="0 25 0">{_HINGE}<geom type="capsule" fromto="0 0 0 0 0 .6" size=".02"/>
<site name="tip" pos="0 0 .6"/></body></body></worldbody></mujoco>""",
    "ball joint": f"""<mujoco><option timestep="0.0005" integrator="RK4"/>{_HEAD}
<body pos="0 0 2" euler="40 20 0"><joint type="ball" damping=".01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02"/><site name="tip" pos="0 0 -.5"/></body>
</worldbody></mujoco>""",
    "crane": f"""<mujoco><option timestep="0.001" solver="PGS" iterations="300"/>{_HEAD}
<body pos="0 0 2"><joint type="slide" axis="1 0 0" stiffness="40" damping="2" springref=".2"/>
<geom type="box" size=".1 .1 .05" mass="3"/>
<body><joint axis="0 1 0" damping=".02"/>
<geom type="capsule" fromto="0 0 0 0 0 -.7" size=".01" mass=".2"/>
<body pos="0 0 -.7"><joint axis="0 1 0" damping=".05" stiffness="1"/>
<geom type="sphere" size=".06" mass="1"/><site name="tip" pos="0 0 -.06"/></body></body></body>
</worldbody></mujoco>""",
}


def end(model: mujoco.MjModel, step: float, integrator: int, length: float) -> np.ndarray:
    """Return where the tip is after a length of time."""
    model = copy.copy(model)
    model.opt.timestep, model.opt.integrator = step, integrator
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(length / step))
    mujoco.mj_kinematics(model, data)
    return data.site("tip").xpos.copy()


def by_hand(model: mujoco.MjModel) -> list[mujoco.MjModel]:
    """Return the model by each integrator at its longest step that keeps the error."""
    exact = end(model, LENGTH / 30000, RK4, LENGTH)
    counts = sorted({*range(37, 150), *(int(LENGTH / h) for h in np.geomspace(2e-4, 1e-2, 40))})
    found = list[mujoco.MjModel]()
    for integrator in range(4):
        for count in counts:
            apart = end(model, LENGTH / count, integrator, LENGTH) - exact
            if np.linalg.norm(apart) <= LIMIT:
                own = copy.copy(model)
                own.opt.timestep, own.opt.integrator = LENGTH / count, integrator
                own.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
                own.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
                own.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
                own.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
                found.append(own)
                break
    return found


def seconds(model: mujoco.MjModel) -> float:
    """Return the CPU time of the run, repeated for some thousands of steps."""
    data, count = mujoco.MjData(model), round(LENGTH / model.opt.timestep)
    repeats = max(1, STEPS // count)
    begin = time.thread_time()
    for _ in range(repeats):
        mujoco.mj_resetData(model, data)
        mujoco.mj_step(model, data, count)
    return (time.thread_time() - begin) / repeats


def measure(name: str, folder: Path) -> str:
    """Return a line about one case."""
    path = folder / f"{name.replace(' ', '_')}.xml"
    path.write_text(CASES[name])
    task = read_task_options(drive="none", duration=f"{LENGTH}s")
    out = folder / path.stem
    request = TuneRequest(str(path), task, LIMIT, None, ("tip",), "end", 200.0)
    report = tune_model(request, Session(out))
    model = mujoco.MjModel.from_xml_path(str(path))
    tuned = mujoco.MjModel.from_xml_path(str(out / report.file)) if report.file else model
    hand, step = by_hand(model), tuned.opt.timestep
    turns = [[seconds(each) for each in (tuned, *hand)] for _ in range(TURNS)]
    ratio = max(median(turn[0] / turn[1 + place] for turn in turns) for place in range(len(hand)))
    length = int(LENGTH / step + 1e-9) * step
    apart = end(tuned, step, int(tuned.opt.integrator), length) - end(
        model, length / 30000, RK4, length
    )
    chosen = ", ".join(f"{each.name} {each.after}" for each in report.changed_settings)
    best = min(hand, key=lambda each: median(seconds(each) for _ in range(TURNS)))
    error = float(np.linalg.norm(apart))
    return (
        f"{name}: tuned/hand {ratio:.2f}, error {error:.2e} m; {chosen}; by hand integrator "
        f"{best.opt.integrator} at {1e3 * best.opt.timestep:.4g} ms; {out / REPORT}"
    )


if __name__ == "__main__":
    register_parts()
    Path(sys.argv[1]).mkdir(parents=True, exist_ok=True)
    for name in CASES:
        print(measure(name, Path(sys.argv[1])), flush=True)
