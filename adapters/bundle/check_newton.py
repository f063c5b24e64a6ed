"""Make the runs of this folder on Newton: python check_newton.py [--device cpu|cuda:0].

It needs `newton` with its MuJoCo solver, and NumPy. What it writes to `results`, `contactlab parity
--from FOLDER` judges; what it prints is only how far each run ended from MuJoCo's.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import newton
import numpy as np

FOLDER = Path(__file__).resolve().parent
_FREE = int(newton.JointType.FREE)
_OF_ITERATIONS = 3 << 9  # bits of MuJoCo Warp's OverflowType that are no matter of room


class Twin:
    """A model as Newton imports it, stepped by its MuJoCo solver, in MuJoCo's coordinates.

    There is room for so many contacts and rows of constraints; settings are the solver's.
    """

    def __init__(
        self,
        mjcf: str,
        timestep: float,
        room: Sequence[int],
        device: str | None = None,
        **settings: object,
    ) -> None:
        builder = newton.ModelBuilder()
        newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
        builder.add_mjcf(mjcf, ctrl_direct=True)
        self.model, self.timestep = builder.finalize(device=device), timestep
        settings = {"nconmax": room[0], "njmax": room[1], **settings}
        self.solver = newton.solvers.SolverMuJoCo(self.model, **settings)
        self.control = self.model.control()

    def run(
        self, qpos: np.ndarray, qvel: np.ndarray, controls: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, bool]:
        """Return (N + 1, nq) and (N + 1, nv) coordinates and velocities, and whether all had room.

        Controls (N, nu) drive the steps from a start.
        """
        now, then = self.model.state(), self.model.state()
        self.start(now, qpos, qvel)
        places, speeds, data, full = [qpos], [qvel], self.solver.mjw_data, False
        for control in controls:
            if len(control):
                self.control.mujoco.ctrl.assign(control.astype(np.float32))
            self.solver.step(now, then, self.control, None, self.timestep)
            now, then = then, now
            # On a CPU these are views of what the next step overwrites.
            places.append(data.qpos.numpy()[0].copy())
            speeds.append(data.qvel.numpy()[0].copy())
            full |= self.is_full()
        return np.array(places, np.float64), np.array(speeds, np.float64), full

    def is_full(self) -> bool:
        """Return whether the last step had too little room for contacts or constraints."""
        data = self.solver.mjw_data
        if hasattr(data, "overflow"):
            return bool(data.overflow.numpy()[0] & ~_OF_ITERATIONS)
        return bool(data.nefc.numpy()[0] > data.njmax or data.nacon.numpy()[0] > data.naconmax)

    def start(self, state: newton.State, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Set a state to MuJoCo's coordinates; the solver starts from nothing."""
        model, data = self.model, self.solver.mjw_data
        data.qacc_warmstart.zero_()
        q, qd = qpos.copy(), qvel.copy()
        if hasattr(model.mujoco, "dof_ref"):
            ref = model.mujoco.dof_ref.numpy()
        else:
            ref = np.zeros(len(qd))
        kinds, children = model.joint_type.numpy(), model.joint_child.numpy()
        starts, dofs = model.joint_q_start.numpy(), model.joint_qd_start.numpy()
        for joint, kind in enumerate(kinds):
            at, dof = starts[joint], dofs[joint]
            if kind == _FREE:
                w, *xyz = qpos[at + 3 : at + 7]
                q[at + 3 : at + 7] = [*xyz, w]
                # MuJoCo turns in the body's frame about its origin, Newton in the world's about
                # the centre of mass.
                turn = rotation(w, *xyz)
                spin = turn @ qvel[dof + 3 : dof + 6]
                centre = turn @ model.body_com.numpy()[children[joint]]
                qd[dof : dof + 3] = qvel[dof : dof + 3] + np.cross(spin, centre)
                qd[dof + 3 : dof + 6] = spin
            else:
                count = starts[joint + 1] - at
                q[at : at + count] = qpos[at : at + count] - ref[dof : dof + count]
        state.joint_q.assign(q.astype(np.float32))
        state.joint_qd.assign(qd.astype(np.float32))


def rotation(w: float, x: float, y: float, z: float) -> np.ndarray:
    """Return (3, 3) the rotation of a quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def check(engine: str, device: str | None = None, **settings: object) -> None:
    """Make every run twice, and single steps from MuJoCo's states, and write the results."""
    runs = json.loads((FOLDER / "bundle.json").read_text())["runs"]
    results = FOLDER / "results"
    results.mkdir(exist_ok=True)
    for run in runs:
        expected = np.load(FOLDER / "runs" / f"{run['id']}.npz")
        qpos, qvel, controls = (expected[name] for name in ("qpos", "qvel", "ctrl"))
        mjcf = (FOLDER / run["model"]).read_text()
        given = {**run["solver"], **settings}
        twin = Twin(mjcf, run["timestep"], run["room"], device, **given)
        told = {}
        for name in ("", "again_"):
            told[f"{name}qpos"], told[f"{name}qvel"], full = twin.run(qpos[0], qvel[0], controls)
            told["full"] = told.get("full", False) or full
        steps = [twin.run(qpos[k], qvel[k], controls[k : k + 1]) for k in expected["places"]]
        told["step_qpos"] = np.array([each[0][1] for each in steps])
        told["step_qvel"] = np.array([each[1][1] for each in steps])
        np.savez(results / f"{run['id']}.npz", **told)
        apart, floor = abs(told["qpos"] - qpos).max(), expected["floor"].max()
        print(f"{run['id'][:8]}  {apart:.2g} from MuJoCo, which rounding moves by {floor:.2g}")
    about = {"engine": engine, "version": newton.__version__, "device": str(twin.model.device)}
    (results / "engine.json").write_text(json.dumps(about))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", help="what Newton computes on; by default its own choice")
    check("newton", parser.parse_args().device)
