"""Examines the loop of a policy: its margins, and the changes that make it hold."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np

from contactlab.closed_loop.control_loop import ControlLoop, LoopRows
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.closed_loop.position_servos import (
    list_stated_servos,
    list_steered_keys,
    move_inside,
)
from contactlab.engines.closed_loop import load_policy
from contactlab.foreign_code import printed_as_text
from contactlab.reporting.loop_words import format_frequency, loop_sentence
from contactlab.scene.model_draft import ModelEdits, object_name
from contactlab.schema.control_loop import ControlLoopReport
from contactlab.schema.drive import Drive, PolicyDrive, drive_text
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
def measure_loop(study: LoopStudy) -> ControlLoopReport:
    """Return the report of a loop, and whether the same PD holds as servos of the model."""
    report, servos = study.measure_margins(), list_stated_servos(study.loop)
    if not servos:
        return report
    inside = study.holds_simulated(move_inside(study.loop, servos))
    return report.model_copy(update={"inside": inside})


def list_loop_facts(report: ControlLoopReport | None) -> Iterator[Fact]:
    """Yield the margins of a loop as a fact; nothing without a loop."""
    if report is not None:
        sentence = loop_sentence(report)
        yield Fact(kind="loop", place=report.joint, value=report.rate, unit="Hz", sentence=sentence)


class LoopRepair(NamedTuple):
    """A change of a model that makes the loop of its policy hold, or another drive.

    Attributes:
        controller: the change of the controller, in words.
    """

    name: str
    apply: str
    edits: ModelEdits
    drive: PolicyDrive | None = None
    controller: str = ""


def list_loop_repairs(
    study: LoopStudy, report: ControlLoopReport, drive: Drive
) -> Iterator[LoopRepair]:
    """Yield changes that make the loop hold, also with twice its gains.

    They are an implicit integrator, more armature or damping of all driven joints, a faster
    loop, with a step that divides its period, and a PD as position servos of the model.
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
        margins_by_name = {margin.name: margin for margin in report.margins}
        border = margins_by_name["armature"].doubled
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
        unit = margins_by_name["armature"].unit
        if word == "damping":
            unit = "Ns/m" if unit == "kg" else "Nms/rad"
        yield LoopRepair(f"{word} {value:g} {unit} of {names[0]}{more}", f"loop-{word}", edits)
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
    if report.inside and isinstance(drive, PolicyDrive):
        yield from _list_inside_repairs(study, drive)


def _list_inside_repairs(study: LoopStudy, drive: PolicyDrive) -> Iterator[LoopRepair]:
    # A constant target: the policy would still want the torques of its own gains.
    loop, servos = study.loop, list_stated_servos(study.loop)
    inside = move_inside(loop, servos)
    (held_controls,) = LoopRows(inside).ask_policy()
    stronger = [
        one.model_copy(update={"kp": _MARGIN * one.kp, "kv": _MARGIN * one.kv}) for one in servos
    ]
    doubled = replace(
        move_inside(loop, stronger),
        policy=lambda _: (
            lambda *observations: np.repeat(held_controls[None], len(observations[0]), axis=0)
        ),
    )
    if not study.holds_simulated(doubled):
        return
    changes = inside.model.opt.integrator != loop.model.opt.integrator
    edits = ModelEdits(
        settings={"integrator": "implicitfast"} if changes else {},
        servos=servos,
        steered=list_steered_keys(loop.model, servos),
    )
    targets = drive.model_copy(update={"send": "targets"})
    name = f"the PD as position servos of the model: --drive {drive_text(targets)}"
    geared = any(loop.model.actuator(one.actuator).gear[0] != 1 for one in servos)
    words = "gear * target" if geared else "the target of its joint"
    line = f"In your own controller, send each motor {words}, not a torque."
    yield LoopRepair(name, "loop-servos", edits, targets, line)


def _round_up(value: float) -> float:
    # To two digits.
    power = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{np.ceil(value / power - 1e-9) * power:.3g}")
