"""The runs of a bench as plain data, for those that step them without contactlab."""

import json
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import mujoco


@dataclass(frozen=True)
class PlainRun:
    """One run.

    Attributes:
        model: the MJCF file.
        solref: of every geom; None to leave them as written.
        qpos: start configuration.
        qvel: start velocity.
        steps: how many to make.
    """

    model: str
    solref: list[float] | None
    qpos: list[float]
    qvel: list[float]
    steps: int

    def start(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return the model and a state to step from."""
        model = _compiled(self.model)
        if self.solref is not None:
            model.geom_solref[:] = self.solref
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = self.qpos, self.qvel
        return model, data


@cache
def _compiled(path: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(path)


def save(runs: list[PlainRun], path: Path) -> None:
    """Write runs as JSON."""
    path.write_text(json.dumps([asdict(run) for run in runs]), encoding="utf-8")


def load(path: Path) -> list[PlainRun]:
    """Read runs that `save` wrote."""
    return [PlainRun(**each) for each in json.loads(path.read_text(encoding="utf-8"))]
