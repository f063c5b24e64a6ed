"""The backward error of engines' runs, by restarts of the same engine from its own states.

Run: python -m bench.engine_budget ENGINE,ENGINE [TASK ...]

Of each task of `sweeps/engines`, at its middle step and for half a second at most: from the state
at the start of every window, of 40 ms or a quarter of what is shorter, the engine itself goes on at
a quarter of its step, and what it parts by is the phantom impulse over the real one, of the worst
body (docs/how-to/budget.md). An engine that chooses its own steps goes on at a sixteenth of an
accuracy of .001, which has steps of a quarter where it is of first order. Told beside it is how far
the engine parts from its own run when it goes on as it did: 0 where a state is all that it knows,
so that it can restart.
"""

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from contactlab.budget.defects import measure_defects, measure_paths
from contactlab.budget.windows import gyration_radii, judged_bodies
from contactlab.contact.trace_arrays import Floats
from contactlab.engines import ENGINES
from contactlab.engines.engine import PreparedRuns
from contactlab.errors import ContactlabError
from contactlab.parts import register_parts
from contactlab.plan.overrides import Overrides
from contactlab.resources import SWEEPS
from contactlab.run.sweep_request import read_request
from contactlab.scene.scene import Scene
from contactlab.schema.setting_values import as_number
from contactlab.studies.parity.panel import roll_out, runs_from_states
from contactlab.tasks.session import Values

_WINDOW, _FEWEST, _FINER, _LONGEST = 0.04, 4, 4, 0.5
_ACCURACY = 0.001  # of an engine that chooses its own steps
_GRAVITY_SHARE = 0.1


def velocities(model: mujoco.MjModel, states: Floats) -> Floats:
    """Return (..., B, 6) velocities of centres of mass, and spins times radii, of (..., nstate)."""
    data, bodies = mujoco.MjData(model), judged_bodies(model).tolist()
    radii, found, six = (
        gyration_radii(model),
        np.zeros((*states.shape[:-1], len(bodies), 6)),
        np.zeros(6),
    )
    for place in np.ndindex(states.shape[:-1]):
        _, data.qpos[:], data.qvel[:], _ = np.split(
            states[place], np.cumsum([1, model.nq, model.nv])
        )
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        for row, body in enumerate(bodies):
            mujoco.mj_objectVelocity(model, data, int(mujoco.mjtObj.mjOBJ_BODY), body, six, 0)
            found[place][row] = *six[3:], *(radii[body] * six[:3])
    return found


def budget(scene: Scene, values: Values, duration: float, engine: str) -> tuple[float, float]:
    """Return the share of the worst body, and the farthest that a restart parts from the run."""
    by, spec = ENGINES[engine], scene.resolve(values, 0, duration)
    runs = PreparedRuns.of(scene, spec)
    own = roll_out(by, runs).state[0].copy()
    each = round(min(_WINDOW, spec.duration / _FEWEST) / spec.timestep)
    starts = np.arange(0, spec.steps - each, each)
    again = roll_out(by, replace(runs_from_states(runs, 0, own[starts], starts), steps=each)).state
    parted = max(
        float(np.abs(back[:, 1:] - own[start : start + each + 1, 1:]).max())
        for start, back in zip(starts, again, strict=True)
    )
    closer = {"timestep": spec.timestep / _FINER}
    if by.controls_error:
        closer["tolerance"] = as_number(spec.settings["tolerance"]) / _FINER**2
    finer = scene.resolve({**values, **closer}, 0, duration)
    fine = runs_from_states(PreparedRuns.of(scene, finer), 0, own[starts], starts)
    states = roll_out(by, replace(fine, steps=_FINER * (each + 1))).state
    model = runs.models[0]
    other = velocities(model, states)
    mine = velocities(model, np.stack([own[at + each - 1 : at + each + 2] for at in starts]))
    apart = measure_defects(mine, other[:, _FINER * (each - 1) :]).sum(axis=0)
    watched = len(starts) * each * spec.timestep
    pull = _GRAVITY_SHARE * float(np.linalg.norm(model.opt.gravity)) * watched
    real = np.linalg.norm(other[0, 0], axis=-1) + pull
    real += measure_paths(other[:, : _FINER * each + 1]).sum(axis=0)
    return float((apart / real).max()), parted


def _assigned(engine: str) -> list[str]:
    chosen = [f"tolerance={_ACCURACY}"] if ENGINES[engine].controls_error else []
    return [f"engine={engine}", *chosen]


def main() -> None:
    """Print a line for each task and engine."""
    engines, *wanted = sys.argv[1:]
    for path in sorted((SWEEPS / "engines").glob("*.yaml")):
        if wanted and path.stem not in wanted:
            continue
        for engine in engines.split(","):
            try:
                request = read_request(
                    path, path.stem, Path("results"), folder=path.parent, workers=0,
                    overrides=Overrides(assign=_assigned(engine)),
                )  # fmt: skip
                planned = list(request.plan.iterate_runs())
                values = planned[len(planned) // 2].values
                spec = request.scene.resolve(values, 0, request.plan.sweep.duration)
                if why := ENGINES[engine].refusal(request.scene, spec):
                    print(f"{path.stem} {engine}: {why}")
                    continue
                share, parted = budget(request.scene, values, min(spec.duration, _LONGEST), engine)
            except ContactlabError as error:
                print(f"{path.stem} {engine}: {' '.join(str(error).split())}")
                continue
            print(f"{path.stem} {engine}: {100 * share:.3g} %, restarts part by {parted:.2g}")


if __name__ == "__main__":
    register_parts()
    main()
