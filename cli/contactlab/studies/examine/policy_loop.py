"""Examines the loop of a policy: its margins, and the changes that make it hold."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.closed_loop.control_loop import INTEGRATION, ControlLoop
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.contact.trace_arrays import Floats
from contactlab.engines.closed_loop import load_policy
from contactlab.engines.pd_controller import find_motors
from contactlab.foreign_code import printed_as_text
from contactlab.reporting.loop_words import format_frequency, loop_sentence
from contactlab.scene.model_draft import ModelEdits, object_name
from contactlab.schema.control_loop import ControlLoopReport
from contactlab.schema.drive import Drive, PdDrive, PolicyDrive, drive_text
from contactlab.schema.examination import Fact
from contactlab.tasks.checked_model import CheckedModel

_MARGIN = 2.0
"""Factor on a border that is recommended: a gain margin of two (6 dB), the usual one."""


def make_loop_study(checked: CheckedModel) -> LoopStudy | None:
    """Return the study of the loop of a task's policy; None without a policy.

    It is linearized at the start, and at two later states of the loop's own run.
    """
    drive, motion = checked.scene.drive.drive, checked.motions[0]
    if not isinstance(drive, PolicyDrive) or not motion.model.nu:
        return None
    loop = ControlLoop(
        model=motion.model,
        policy=load_policy(checked.scene.drive),
        start=motion.starts[0],
        rate=drive.rate,
        latency=drive.latency_seconds,
    )
    duration = checked.task.duration
    return LoopStudy(loop, (0.0, duration / 4, duration / 2))


@printed_as_text()
def measure_loop(checked: CheckedModel, study: LoopStudy) -> ControlLoopReport:
    """Return the report of a loop, and whether the same PD holds as servos of the model."""
    report, drive = study.measure_margins(), checked.scene.drive.drive
    if not isinstance(drive, PdDrive):
        return report
    servos, held = make_position_servos(study.loop, drive)
    inside = replace(
        study.loop,
        model=servos,
        policy=lambda _: lambda *seen: np.repeat(held[None], len(seen[0]), axis=0),
        rate=1 / float(servos.opt.timestep),
        latency=0.0,
    )
    return report.model_copy(update={"inside": study.holds_simulated(inside)})


def make_position_servos(loop: ControlLoop, drive: PdDrive) -> tuple[mujoco.MjModel, Floats]:
    """Return a model with a PD as position servos and implicitfast, and (nu,) their targets."""
    model, motors = loop.model.__copy__(), find_motors(loop.model)
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, loop.start, INTEGRATION)
    driven = np.flatnonzero(motors.controls)
    gears = model.actuator_gear[driven, 0]
    model.actuator_biastype[driven] = int(mujoco.mjtBias.mjBIAS_AFFINE)
    model.actuator_gainprm[driven, 0] = drive.kp / gears**2
    model.actuator_biasprm[driven, 1] = -drive.kp / gears**2
    model.actuator_biasprm[driven, 2] = -drive.kd / gears**2
    model.actuator_ctrllimited[driven] = 0
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    targets = np.zeros(model.nu)
    targets[driven] = gears * data.qpos[motors.places[driven]]
    return model, targets


def list_loop_facts(report: ControlLoopReport | None) -> Iterator[Fact]:
    """Yield the margins of a loop as a fact; nothing without a loop."""
    if report is not None:
        sentence = loop_sentence(report)
        yield Fact(kind="loop", place=report.joint, value=report.rate, unit="Hz", sentence=sentence)


class LoopRepair(NamedTuple):
    """A change of a model with which the loop of its policy holds, or a faster drive."""

    name: str
    apply: str
    edits: ModelEdits
    drive: PolicyDrive | None = None


def list_loop_repairs(
    study: LoopStudy, report: ControlLoopReport, drive: Drive
) -> Iterator[LoopRepair]:
    """Yield changes with which the loop holds, also with twice its gains.

    They are an implicit integrator, more armature or damping of all driven joints, and a faster
    loop, with a step that divides its period.
    """
    loop = study.loop
    implicit = replace(loop, model=loop.model.__copy__(), gain=_MARGIN)
    implicit.model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    if study.holds_simulated(implicit):
        yield LoopRepair("implicitfast", "implicit", ModelEdits({"integrator": "implicitfast"}))
    for field, word, make in (
        ("dof_armature", "armature", loop.with_armature),
        ("dof_damping", "damping", loop.with_damping),
    ):
        known = {margin.name: margin.doubled for margin in report.margins}
        border = known.get("armature")
        if word == "damping":
            border = replace(study, loop=replace(loop, gain=_MARGIN)).find_damping()
        if not border:
            continue
        value = _round_up(border)
        if not study.holds_simulated(replace(make(value), gain=_MARGIN)):
            continue
        values = getattr(loop.model, field)
        dofs = [int(dof) for dof in loop.driven_dofs if values[dof] < value]
        names = [object_name(loop.model, field, dof) for dof in dofs]
        edits = ModelEdits({f"{field}[{name}]": value for name in names})
        more = f" and {len(names) - 1} more joints" if len(names) > 1 else ""
        yield LoopRepair(f"{word} {value:g} of {names[0]}{more}", f"loop-{word}", edits)
    rate = {margin.name: margin.doubled for margin in report.margins}.get("rate")
    if rate and isinstance(drive, PolicyDrive):
        faster = replace(loop, rate=_round_up(rate), gain=_MARGIN)
        if study.holds_simulated(faster):
            step = (
                {"timestep": faster.timestep} if faster.rate * loop.model.opt.timestep > 1 else {}
            )
            quicker = drive.model_copy(update={"rate": faster.rate})
            name = f"a loop at {format_frequency(faster.rate)}: --drive {drive_text(quicker)}"
            yield LoopRepair(name, "loop-rate", ModelEdits(step), quicker)


def _round_up(value: float) -> float:
    # To two digits.
    power = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{np.ceil(value / power - 1e-9) * power:.3g}")
