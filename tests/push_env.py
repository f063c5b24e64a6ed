"""An environment without Gymnasium, and policies that act in it; its file is copied by tests."""

from typing import Any

import mujoco
import numpy as np

PUSHED = """
<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body name="puck" pos="0 0 .05"><joint name="x" type="slide" axis="1 0 0"/>
    <joint name="z" type="slide" axis="0 0 1"/>
    <geom name="puck" type="box" size=".05 .05 .05" mass="1"/></body>
</worldbody><actuator><motor name="push" joint="x"/></actuator>
<sensor><jointpos joint="x"/></sensor></mujoco>"""
SKIP = 5
FAR = 0.3


class Forces:
    """Draws forces, as spaces of Gymnasium do."""

    def seed(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def sample(self) -> Any:
        return self._rng.uniform(-30, 30, 1)


class Push:
    """Pushes a puck until it is far away."""

    action_space: Any = Forces()

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(PUSHED)
        self.data = mujoco.MjData(self.model)

    def reset(self, *, seed: int) -> Any:  # noqa: ARG002 - it always starts alike
        mujoco.mj_resetData(self.model, self.data)
        return self.data.qpos.copy(), {}

    def step(self, action: Any) -> Any:
        self.data.ctrl[:] = action
        mujoco.mj_step(self.model, self.data, nstep=SKIP)
        place = float(self.data.qpos[0])
        return self.data.qpos.copy(), place, abs(place) > FAR, False, {"success": place > FAR}


class Stubborn(Push):
    """Writes its own friction when it is reset."""

    def reset(self, *, seed: int) -> Any:
        self.model.geom_friction[:, 0] = 0.3
        return super().reset(seed=seed)


class Varied(Push):
    """Draws another size of its floor when it is reset, and slows down under way."""

    def reset(self, *, seed: int) -> Any:
        self.model.geom_pos[0, 0] = np.random.default_rng(seed).uniform()
        return super().reset(seed=seed)

    def step(self, action: Any) -> Any:
        self.model.dof_damping[0] += 0.1
        return super().step(action)


class Unseeded(Push):
    """Starts anywhere."""

    def reset(self, *, seed: int) -> Any:
        answer = super().reset(seed=seed)
        self.data.qpos[0] = np.random.default_rng().uniform(0, 0.1)
        return answer


class Anew(Push):
    """Makes another model when it is reset."""

    def reset(self, *, seed: int) -> Any:
        super().__init__()
        return super().reset(seed=seed)


class Failing(Push):
    """Fails in its third step if its seed is odd."""

    def reset(self, *, seed: int) -> Any:
        self.left = 2 if seed % 2 else 1000
        return super().reset(seed=seed)

    def step(self, action: Any) -> Any:
        if not self.left:
            raise ValueError("out of ideas")
        self.left -= 1
        return super().step(action)


class Unheard(Push):
    """Steps where nobody listens."""

    def step(self, action: Any, step: Any = mujoco.mj_step) -> Any:
        self.data.ctrl[:] = action
        step(self.model, self.data)
        return self.data.qpos.copy(), 0.0, False, False, {}


class Looping(Push):
    """Resets itself in its fourth step, and goes on."""

    def reset(self, *, seed: int) -> Any:
        self.made = 0
        return super().reset(seed=seed)

    def step(self, action: Any) -> Any:
        self.made += 1
        if self.made == 4:
            mujoco.mj_resetData(self.model, self.data)
        return super().step(action)


class Unrewarded(Push):
    """Has no number to say of its first step."""

    def step(self, action: Any) -> Any:
        seen, _, *rest = super().step(action)
        return seen, float("nan"), *rest


class Unplaced(Push):
    """Begins nowhere."""

    def reset(self, *, seed: int) -> Any:
        answer = super().reset(seed=seed)
        self.data.qpos[0] = np.nan
        return answer


class Rough(Push):
    """Has an impedance that is no number."""

    def reset(self, *, seed: int) -> Any:
        self.model.geom_solimp[1, 1] = np.nan
        return super().reset(seed=seed)


class Other(Push):
    """Makes a model with other names when it is reset."""

    def reset(self, *, seed: int) -> Any:
        self.model = mujoco.MjModel.from_xml_string(PUSHED.replace("puck", "disk"))
        self.data = mujoco.MjData(self.model)
        return super().reset(seed=seed)


class Slowing(Push):
    """Makes longer steps from the second one on."""

    def step(self, action: Any) -> Any:
        answer = super().step(action)
        self.model.opt.timestep = 3e-3
        return answer


class Closed(Push):
    """Has no actions to draw."""

    action_space = None


class NoModel:
    """Steps no MuJoCo."""


def nothing() -> Any:
    return None


def broken() -> Any:
    raise RuntimeError("no robot here")


class Constant:
    """A policy that acts on the state, and keeps a control for two steps at 50 Hz."""

    def __init__(self, model: mujoco.MjModel) -> None:
        assert model.nu == 1

    def __call__(self, time: Any, qpos: Any, qvel: Any, sensordata: Any) -> Any:
        assert (time.shape, qvel.shape) == ((1,), (1, 2))
        assert np.isclose(qpos[0, 0], sensordata[0, 0], atol=0.1)
        return 12 * np.cos(40 * time)[:, None] - 3 * qpos[:, :1]


class Wild(Constant):
    """A policy that returns no number from 0.06 s on."""

    def __call__(self, time: Any, *_: Any) -> Any:
        return np.full((1, 1), 1.0 if time[0] < 0.05 else np.nan)


class Seeing:
    """A policy that acts on what the environment observes."""

    def __init__(self, model: mujoco.MjModel) -> None:
        assert model.nsensor == 1

    def act(self, observation: Any) -> Any:
        assert observation.shape == (2,)
        return np.array([5 - 20 * observation[0]])
