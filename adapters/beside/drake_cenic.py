"""Drake's integrators with error control on tasks with a closed form: python drake_cenic.py.

A continuous plant with point contacts; CENIC (Kurtz and Castro, arXiv 2511.08771) beside an
explicit and an implicit one, at three accuracies. Printed are errors, and CPU time and steps of a
second.
"""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from pydrake import geometry
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder

# With friction the others take minutes for a second at the finest.
SCHEMES = {
    "cenic": (1e-1, 1e-3, 1e-5),
    "runge_kutta3": (1e-1, 1e-2, 1e-3),
    "implicit_euler": (1e-1, 1e-2, 1e-3),
}
GRAVITY, FRICTION, STIFFNESS = 9.81, 0.5, 1e5
BALL, BOX = 0.05, 0.1  # radius, edge [m]; each has a mass of 1 kg


class World:
    """A ball or a box on a floor, under gravity that is tilted by an angle about y."""

    def __init__(self, ball: bool, tilt: float = 0.0) -> None:
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(time_step=0.0, contact_model="point")
        self.plant, _ = AddMultibodyPlant(config, builder)
        cube = SpatialInertia.SolidBoxWithMass(1.0, BOX, BOX, BOX)
        inertia = SpatialInertia.SolidSphereWithMass(1.0, BALL) if ball else cube
        self.body = self.plant.AddRigidBody("body", inertia)
        shape = geometry.Sphere(BALL) if ball else geometry.Box(BOX, BOX, BOX)
        ways = RigidTransform()
        for body, each, name, hard in (
            (self.body, shape, "shape", STIFFNESS),
            (self.plant.world_body(), geometry.HalfSpace(), "floor", 1e30),
        ):
            made = geometry.ProximityProperties()
            geometry.AddContactMaterial(
                properties=made, friction=CoulombFriction(FRICTION, FRICTION),
                point_stiffness=hard, dissipation=0.0,
            )  # fmt: skip
            self.plant.RegisterCollisionGeometry(body, ways, each, name, made)
        down = GRAVITY * np.array([math.sin(tilt), 0.0, -math.cos(tilt)])
        self.plant.mutable_gravity_field().set_gravity_vector(down)
        self.plant.Finalize()
        self.simulator = Simulator(builder.Build())
        root = self.simulator.get_mutable_context()
        self.context = self.plant.GetMyMutableContextFromRoot(root)

    def run(
        self, scheme: str, accuracy: float, height: float, speed: float, duration: float
    ) -> tuple[np.ndarray, np.ndarray, float, int]:
        """Return the place and velocity at the end, CPU time [s] and steps."""
        config = SimulatorConfig(
            integration_scheme=scheme, accuracy=accuracy, use_error_control=True, max_step_size=0.1
        )
        ApplySimulatorConfig(config, self.simulator)
        pose = RigidTransform(RotationMatrix(), [0, 0, height])
        self.plant.SetFreeBodyPose(self.context, self.body, pose)
        velocity = SpatialVelocity(np.zeros(3), [speed, 0, 0])
        self.plant.SetFreeBodySpatialVelocity(self.context, self.body, velocity)
        self.simulator.Initialize()
        begin = time.process_time()
        self.simulator.AdvanceTo(duration)
        cost = (time.process_time() - begin) / duration
        place = self.plant.EvalBodyPoseInWorld(self.context, self.body).translation()
        moves = self.plant.EvalBodySpatialVelocityInWorld(self.context, self.body)
        steps = self.simulator.get_integrator().get_num_steps_taken()
        return place, moves.translational(), cost, round(steps / duration)


def bounce(run: Callable[..., Any]) -> tuple[float, float, int]:
    """Return the relative error of the energy of a ball that falls by 1 m onto an elastic floor."""
    place, moves, *told = run(World(ball=True), height=1 + BALL, speed=0.0, duration=0.6)
    return ((place[2] - BALL) * GRAVITY + moves[2] ** 2 / 2) / GRAVITY - 1, *told


def slide(run: Callable[..., Any]) -> tuple[float, float, int]:
    """Return the error of the way of a box at 2 m/s on friction .5 after .3 s, relative."""
    rest = BOX / 2 - GRAVITY / STIFFNESS / 4
    place, _, *told = run(World(ball=False), height=rest, speed=2.0, duration=0.3)
    return place[0] / (2 * 0.3 - FRICTION * GRAVITY * 0.3**2 / 2) - 1, *told


def roll(run: Callable[..., Any]) -> tuple[float, float, int]:
    """Return the error of the way of a ball that rolls down 15 degrees for .5 s, relative."""
    tilt = math.radians(15)
    rest = BALL - GRAVITY * math.cos(tilt) / STIFFNESS
    place, _, *told = run(World(ball=True, tilt=tilt), height=rest, speed=0.0, duration=0.5)
    return place[0] / (5 / 7 * GRAVITY * math.sin(tilt) * 0.5**2 / 2) - 1, *told


def stick(run: Callable[..., Any]) -> tuple[float, float, int]:
    """Return how far a box slides in .5 s on 20 degrees, which friction holds [m]."""
    tilt = math.radians(20)
    rest = BOX / 2 - GRAVITY * math.cos(tilt) / STIFFNESS / 4
    place, _, *told = run(World(ball=False, tilt=tilt), height=rest, speed=0.0, duration=0.5)
    return place[0], *told


if __name__ == "__main__":
    for task in (bounce, slide, roll, stick):
        for scheme, accuracies in SCHEMES.items():
            for accuracy in accuracies:
                error, cost, steps = task(partial(World.run, scheme=scheme, accuracy=accuracy))
                told = f"{task.__name__} {scheme} {accuracy:g} {error:.2g}"
                print(f"{told} {1e3 * cost:.3g} ms {steps}", flush=True)  # noqa: T201
