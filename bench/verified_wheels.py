"""Planted changes of public models: harm has to be found by its measure, and no harm has to pass.

Run: python -m bench.verified_wheels FOLDER [WORD ...]

FOLDER has the unpacked wheels of dm_control 1.0.50 and gymnasium_robotics 1.4.2. With words, only
changes whose line has one of them are made. Each changes one thing; why a harmful one is worse
follows from the model.
"""

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco

from contactlab.parts import register_parts
from contactlab.studies.verification import VerificationRequest, verify_change
from contactlab.tasks.checked_model import CheckedModel, open_model
from contactlab.tasks.session import Session

Edit = Callable[[mujoco.MjSpec], None]
SUITE = "dm_control/suite"
ENVS = "gymnasium_robotics/envs/mujoco/assets"
HINGE = mujoco.mjtJoint.mjJNT_HINGE


@dataclass(frozen=True)
class PlantedChange:
    """One change of a public model.

    Attributes:
        name: the change in a few words.
        model: its file, below the folder.
        edit: changes its specification.
        measures: names of measures, of which one has to be worse; empty if nothing is.
        same_model: whether it is declared another computation of the same model.
    """

    name: str
    model: str
    edit: Edit
    measures: tuple[str, ...] = ()
    same_model: bool = True


def set_options(**values: object) -> Edit:
    """Return the edit that sets options."""

    def edit(spec: mujoco.MjSpec) -> None:
        for name, value in values.items():
            setattr(spec.option, name, value)

    return edit


def edit_parts(kind: str, change: Callable[[Any], None], word: str = "") -> Edit:
    """Return the edit that changes all parts of a kind with a word in their name."""

    def edit(spec: mujoco.MjSpec) -> None:
        for part in getattr(spec, kind):
            if word in part.name:
                change(part)

    return edit


def set_fields(**values: object) -> Callable[[Any], None]:
    """Return the change that sets fields of a part."""

    def change(part: object) -> None:
        for name, value in values.items():
            setattr(part, name, value)

    return change


def set_hinges(**values: object) -> Edit:
    """Return the edit that sets fields of all hinges."""
    change = set_fields(**values)
    return edit_parts("joints", lambda joint: change(joint) if joint.type == HINGE else None)


def halve_gain(actuator: mujoco.MjsActuator) -> None:
    """Halve the gain of a position servo."""
    gain, bias = actuator.gainprm.copy(), actuator.biasprm.copy()
    gain[0], bias[1] = gain[0] / 2, bias[1] / 2
    actuator.gainprm, actuator.biasprm = gain, bias


def halve_gear(actuator: mujoco.MjsActuator) -> None:
    """Halve the gear of an actuator."""
    actuator.gear = actuator.gear / 2


def halve_stiffness(joint: mujoco.MjsJoint) -> None:
    """Halve the stiffness of a joint."""
    joint.stiffness = joint.stiffness / 2


def exclude_pair(first: str, second: str) -> Edit:
    """Return the edit that excludes the contacts of two bodies."""

    def edit(spec: mujoco.MjSpec) -> None:
        spec.add_exclude(bodyname1=first, bodyname2=second)

    return edit


def add_mesh(spec: mujoco.MjSpec) -> None:
    """Add a mesh that no geom uses."""
    spec.add_mesh(name="unused", uservert=[0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1])


def add_geom(**values: object) -> Edit:
    """Return the edit that adds a geom to the world."""

    def edit(spec: mujoco.MjSpec) -> None:
        set_fields(**values)(spec.worldbody.add_geom(name="added"))

    return edit


SPHERE, BOX = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
ENERGY = ("energy error", "energy gain", "end position", "tracking error")
CHANGES = (
    PlantedChange(
        "a heavier armature", f"{SUITE}/cheetah.xml",
        edit_parts("joints", set_fields(armature=2.0), "thigh"), ("tracking error",), False,
    ),
    PlantedChange(
        "springs of half stiffness", f"{SUITE}/cheetah.xml",
        edit_parts("joints", halve_stiffness, "thigh"), ("tracking error", "end position"), False,
    ),
    PlantedChange(
        "soft feet", f"{SUITE}/hopper.xml", edit_parts("geoms", set_fields(solref=[0.2, 1])),
        ("depth", "resting depth"), False,
    ),
    PlantedChange(
        "a longer string", f"{SUITE}/ball_in_cup.xml",
        edit_parts("tendons", set_fields(range=[0, 0.36])), ("end position",), False,
    ),
    PlantedChange(
        "half the gear", f"{SUITE}/reacher.xml", edit_parts("actuators", halve_gear),
        ("tracking error",), False,
    ),
    PlantedChange(
        "Euler for Runge-Kutta", f"{SUITE}/cartpole.xml",
        set_options(integrator=mujoco.mjtIntegrator.mjINT_EULER), ("numerical error", *ENERGY),
    ),
    PlantedChange(
        "thin water", f"{SUITE}/fish.xml", set_options(density=1000.0), ENERGY, False
    ),
    PlantedChange(
        "half the gain", f"{SUITE}/quadruped.xml", edit_parts("actuators", halve_gain),
        ("tracking error",), False,
    ),
    PlantedChange(
        "ice", f"{SUITE}/quadruped.xml",
        edit_parts("geoms", set_fields(friction=[0.02, 0.005, 0.0001])),
        ("end position", "creep"), False,
    ),
    PlantedChange(
        "dry friction", f"{ENVS}/pusher.xml", set_hinges(frictionloss=0.5), ("tracking error",),
        False,
    ),
    PlantedChange(
        "a coarse step", f"{SUITE}/walker.xml", set_options(timestep=0.01),
        ("numerical error", "tracking error"),
    ),
    PlantedChange(
        "a floor that a foot misses", f"{SUITE}/walker.xml", exclude_pair("world", "right_foot"),
        ("end position", "numerical error"),
    ),
    PlantedChange(
        "damping of the hinge", f"{SUITE}/pendulum.xml", set_hinges(damping=[2.0, 0, 0]), ENERGY,
        False,
    ),
    PlantedChange(
        "no drag", f"{SUITE}/swimmer.xml", set_options(density=0.0, viscosity=0.0), ENERGY, False
    ),
    PlantedChange(
        "no limits", f"{ENVS}/ant.xml", set_hinges(limited=0),
        ("hinge beyond its limit", "end position", "tracking error"), False,
    ),
    PlantedChange("an unused mesh", f"{SUITE}/cheetah.xml", add_mesh),
    PlantedChange("half the step", f"{SUITE}/cheetah.xml", set_options(timestep=0.005)),
    PlantedChange("more iterations", f"{SUITE}/hopper.xml", set_options(iterations=400)),
    PlantedChange("a tight tolerance", f"{SUITE}/walker.xml", set_options(tolerance=1e-12)),
    PlantedChange(
        "a dense Jacobian", f"{SUITE}/quadruped.xml",
        set_options(jacobian=mujoco.mjtJacobian.mjJAC_DENSE),
    ),
    PlantedChange(
        "noslip without contacts", f"{SUITE}/cartpole.xml", set_options(noslip_iterations=5)
    ),
    PlantedChange(
        "cones without contacts", f"{SUITE}/fish.xml",
        set_options(cone=mujoco.mjtCone.mjCONE_ELLIPTIC),
    ),
    PlantedChange(
        "a far sphere", f"{SUITE}/pendulum.xml",
        add_geom(type=SPHERE, size=[0.1, 0, 0], pos=[30, 30, 5]),
    ),
    PlantedChange("half the step", f"{SUITE}/swimmer.xml", set_options(timestep=0.001)),
    PlantedChange(
        "another solver", f"{SUITE}/reacher.xml", set_options(solver=mujoco.mjtSolver.mjSOL_CG)
    ),
    PlantedChange(
        "a visual geom", f"{ENVS}/ant.xml",
        add_geom(type=BOX, size=[0.1, 0.1, 0.1], contype=0, conaffinity=0),
    ),
    PlantedChange(
        "parent and child excluded", f"{ENVS}/inverted_double_pendulum.xml",
        exclude_pair("pole", "pole2"),
    ),
)  # fmt: skip


def main(folder: Path, words: Sequence[str]) -> None:
    """Verify each change, and print whether the result is right."""
    register_parts()
    right = count = 0
    for change in CHANGES:
        if words and not any(word in f"{change.name} {change.model}" for word in words):
            continue
        begin = time.process_time()
        with TemporaryDirectory() as made:
            original = _open(Path(made) / "original", folder / change.model, lambda _: None)
            changed = _open(Path(made) / "changed", folder / change.model, change.edit)
            request = VerificationRequest(original, changed, same_model=change.same_model)
            found = verify_change(request)
        worse = {measure.name for measure in found.measures if measure.worse}
        holds = bool(worse & {*change.measures}) if change.measures else found.passed
        right, count = right + holds, count + 1
        seconds = time.process_time() - begin
        print(
            f"{'right' if holds else 'WRONG'} {change.name} ({Path(change.model).stem}, "
            f"{seconds:.1f} s): {found.sentence}",
            flush=True,
        )
    print(f"{right} of {count} right")


def _open(folder: Path, model: Path, edit: Edit) -> CheckedModel:
    spec = mujoco.MjSpec.from_file(str(model))
    edit(spec)
    spec.compile()
    folder.mkdir()
    (folder / "model.xml").write_text(spec.to_xml())
    return open_model(str(folder / "model.xml"), Session(folder / "results"))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
