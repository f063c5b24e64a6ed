"""Stands in for a bundle's script where MuJoCo is all there is: check_mujoco.py FOLDER [DEFECT]."""

import json
import sys
from pathlib import Path

import mujoco
import numpy as np


def main(folder: Path, defect: str = "") -> None:
    results = folder / "results"
    results.mkdir()
    for run in json.loads((folder / "bundle.json").read_text())["runs"]:
        expected = np.load(folder / "runs" / f"{run['id']}.npz")
        model = mujoco.MjModel.from_xml_path(str(folder / run["model"]))
        if defect == "friction":
            model.geom_friction *= 1.05
        qpos, qvel, controls = (expected[name] for name in ("qpos", "qvel", "ctrl"))
        if defect == "late":
            controls = np.concatenate([controls[:1], controls[:-1]])
        told = {"full": np.array(defect == "buffer")}
        for name in ("", "again_"):
            told[f"{name}qpos"], told[f"{name}qvel"] = made(model, qpos[0], qvel[0], controls)
        steps = [
            made(model, qpos[k], qvel[k], expected["ctrl"][k : k + 1]) for k in expected["places"]
        ]
        told["step_qpos"] = np.array([each[0][1] for each in steps])
        told["step_qvel"] = np.array([each[1][1] for each in steps])
        if defect != "missing":
            np.savez(results / f"{run['id']}.npz", allow_pickle=False, **told)
    about = {"engine": "stand-in", "version": "1", "device": "cpu"}
    (results / "engine.json").write_text(json.dumps(about))


def made(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, controls: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    states = [(qpos, qvel)]
    for control in controls:
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        states.append((data.qpos.copy(), data.qvel.copy()))
    places, speeds = zip(*states, strict=True)
    return np.array(places), np.array(speeds)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
