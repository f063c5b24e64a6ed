"""Finds the margins of a control loop: by its eigenvalues, and then by simulation."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np

from contactlab.closed_loop.borders import find_border
from contactlab.closed_loop.control_loop import ControlLoop, find_modes, simulate_growth
from contactlab.scene.model_names import name_of
from contactlab.schema.control_loop import ControlLoopReport, LoopMargin

_ROUNDING = 5e-4
"""Of an eigenvalue: the root of the rounding of a derivative, as of double eigenvalues."""
Holds = Callable[[ControlLoop], bool]


@dataclass(frozen=True)
class LoopStudy:
    """A loop under examination.

    Attributes:
        loop: as it is.
        times: of its run when it is linearized [s].
        periods: of a run, unless it has more than ten times as many steps.
    """

    loop: ControlLoop
    times: tuple[float, ...] = (0.0,)
    periods: int = 1000

    @cached_property
    def natural_growth(self) -> float:
        """Growth of the model under a much faster controller [1/s]: that of a fall, at most."""
        loop, faster = self.loop, 8.0
        rate = faster * max(loop.rate, 1 / float(loop.model.opt.timestep))
        growth, _ = find_modes(replace(loop, rate=rate, latency=0.0), np.array([0.0]))
        slow = 20.0  # a fall of a robot of 25 mm; what grows faster is no fall
        return max(0.0, growth) if growth < slow else 0.0

    def allow_growth(self, loop: ControlLoop) -> float:
        """Return the largest growth of a loop that holds [1/s]."""
        return 1.5 * self.natural_growth + _ROUNDING * loop.rate

    def holds_linear(self, loop: ControlLoop) -> bool:
        """Return whether no mode of the linear loop grows."""
        growth, _ = find_modes(loop, np.array(self.times))
        return growth <= self.allow_growth(loop)

    def run_loop(self, loop: ControlLoop) -> float:
        """Return the growth of a small offset in a run [1/s], above the resolution of the run."""
        periods, steps = self.periods, 10 * self.periods
        seconds = min(max(periods / loop.rate, 0.5), max(steps * loop.timestep, 20 / loop.rate))
        resolved = math.log(1.2) / (0.7 * seconds)
        return simulate_growth(loop, seconds) - max(0.0, resolved - _ROUNDING * loop.rate)

    def holds_simulated(self, loop: ControlLoop) -> bool:
        """Return whether a small offset does not grow in a run."""
        return self.run_loop(loop) <= self.allow_growth(loop)

    def measure_margins(self) -> ControlLoopReport:
        """Return the report of the loop with all margins."""
        loop = self.loop
        growth, dof = find_modes(loop, np.array(self.times))
        simulated = self.run_loop(loop)
        allowed = self.allow_growth(loop)
        holds = simulated <= allowed
        return ControlLoopReport(
            rate=loop.rate,
            latency=loop.latency,
            timestep=loop.timestep,
            growth=growth,
            eigenvalue=math.exp(min(growth / loop.rate, 700.0)),
            joint=name_of(loop.model, "joint", int(loop.model.dof_jntid[dof])),
            simulated_growth=simulated,
            allowed_growth=allowed,
            holds=holds,
            margins=tuple(self._find_margin(axis, safe=not holds) for axis in self.list_axes()),
        )

    def find_damping(self) -> float | None:
        """Return the least damping of all driven joints that holds in a run; None without one."""
        loop, most = self.loop, 1e3
        dofs = loop.driven_dofs
        own = float(loop.model.dof_damping[dofs].min(initial=math.inf)) if len(dofs) else 0.0
        axis = LoopAxis("armature", "", True, own, (1e-4, most), loop.with_damping)
        return axis.find_border(self.holds_simulated, axis.find_border(self.holds_linear, None))

    def list_axes(self) -> tuple["LoopAxis", ...]:
        """Return the parameters that have margins."""
        loop = self.loop
        dofs = loop.driven_dofs
        armature = float(loop.model.dof_armature[dofs].min(initial=math.inf)) if len(dofs) else 0.0
        inertia = float(np.median(loop.model.dof_M0[dofs])) if len(dofs) else 1.0
        most = 2 * loop.model.nv + 1.0  # seconds
        kinds = loop.model.jnt_type[loop.model.dof_jntid[dofs]]
        slides = len(dofs) and np.all(kinds == mujoco.mjtJoint.mjJNT_SLIDE)
        return (
            LoopAxis("rate", "Hz", True, loop.rate, (1.0, 1e5), lambda v: replace(loop, rate=v)),
            LoopAxis(
                "delay",
                "s",
                False,
                loop.latency,
                (loop.timestep, min(most, 1.0)),
                lambda v: replace(loop, latency=v),
            ),
            LoopAxis("gain", "1", False, loop.gain, (0.01, 100.0), lambda v: replace(loop, gain=v)),
            LoopAxis(
                "armature",
                "kg" if slides else "kg m^2",
                True,
                armature,
                (1e-4 * inertia, 1e4 * inertia),
                loop.with_armature,
            ),
        )

    def _find_margin(self, axis: "LoopAxis", *, safe: bool) -> LoopMargin:
        linear = axis.find_border(self.holds_linear, None)
        border = axis.find_border(self.holds_simulated, linear)
        doubled = None
        if safe and axis.holds_above and border:
            twice = replace(self, loop=replace(self.loop, gain=2 * self.loop.gain))
            (other,) = (one for one in twice.list_axes() if one.name == axis.name)
            doubled = other.find_border(self.holds_simulated, 2 * border)
        return LoopMargin(
            name=axis.name,
            unit=axis.unit,
            holds_above=axis.holds_above,
            current=axis.current,
            linear=linear,
            border=border,
            doubled=doubled,
        )


@dataclass(frozen=True)
class LoopAxis:
    """A parameter of a loop, with the range of the search for its border."""

    name: Literal["rate", "delay", "gain", "armature"]
    unit: str
    holds_above: bool
    current: float
    within: tuple[float, float]
    make: Callable[[float], ControlLoop]

    def find_border(self, loop_holds: Holds, near: float | None) -> float | None:
        """Return the last value that holds, from the current one or near a known border."""

        def holds_with(value: float) -> bool:
            return loop_holds(self.make(value))

        least, most = self.within
        value = near or self.current or least
        factor = 1.1 if near else 2.0  # a known border is near
        value = before = min(max(value, least), most)
        is_holding = holds_with(value)
        grows = self.holds_above != is_holding  # toward larger values
        while holds_with(value) == is_holding:
            before, value = value, value * factor if grows else value / factor
            factor *= factor if near else 1.0
            if not least <= value <= most:
                return None if is_holding or not holds_with(self.current) else self.current
        inside, outside = (before, value) if is_holding else (value, before)
        return find_border(holds_with, inside, outside, 0.01)
