"""Which settings only discretise a model, and which are part of the model itself.

Runs that differ only in settings that discretise converge to one limit as the timestep goes to 0,
and so share a reference. All other settings change the limit: contact parameters (solref, solimp,
friction, condim, margin, gap), cone and impratio, gravity and the like, and what the manifest sets.
Of settings that look numerical, these are part of the model:

- noslip_iterations, noslip_tolerance: the noslip pass removes slip that the contact model has; how
  much remains depends on its iterations, at any timestep.
- refsafe: without it solref is taken as written at any timestep; with it only where the timestep is
  small enough, which is an error of the run, marked as `solref_clamped`.
- multiccd, nativeccd, speculative, diagexact: these change the contacts or their impedances.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.setting_values import Settings


@dataclass(frozen=True)
class NumericSetting:
    """A setting or flag that only discretises.

    Attributes:
        reference: its value in a reference; None where each reference chooses.
        reason: why the limit does not depend on it.
    """

    reference: object
    reason: str


_SOLVED = "the constraint problem is convex: every converged solver gives the same answer"
_DISTANCE = "how accurately the distance of convex shapes is computed"
NUMERICS: Mapping[str, NumericSetting] = MappingProxyType(
    {
        "timestep": NumericSetting(None, "what goes to zero"),
        "integrator": NumericSetting(
            None, "all are consistent: they differ by powers of the timestep"
        ),
        "solver": NumericSetting("Newton", _SOLVED),
        "iterations": NumericSetting(200, _SOLVED),
        "tolerance": NumericSetting(1e-12, _SOLVED),
        "ls_iterations": NumericSetting(50, _SOLVED),
        "ls_tolerance": NumericSetting(0.01, _SOLVED),
        "jacobian": NumericSetting("auto", "how the same matrix is stored"),
        "ccd_iterations": NumericSetting(200, _DISTANCE),
        "ccd_tolerance": NumericSetting(1e-9, _DISTANCE),
        "warmstart": NumericSetting(True, "where the solver starts; " + _SOLVED),
        "island": NumericSetting(
            True, "bodies that do not touch are solved separately; " + _SOLVED
        ),
        "midphase": NumericSetting(True, "how distant pairs are skipped"),
        "eulerdamp": NumericSetting(True, "damping evaluated at the end of a step or at its start"),
        "sleep": NumericSetting(False, "skips bodies at rest, which should not move anyway"),
    }
)


def with_reference_numerics(run: ResolvedRun, integrator: str, timestep: float) -> ResolvedRun:
    """Return a run with the numerics of a reference, whose timestep [s] is given.

    Runs that differ only in numerics give equal references.
    """
    chosen = {name: each.reference for name, each in NUMERICS.items()}
    chosen |= {"integrator": integrator, "timestep": timestep}
    settings = Settings({name: chosen.get(name, value) for name, value in run.settings.items()})
    flags = {name: bool(chosen.get(name, state)) for name, state in run.flags.items()}
    written = {name for name in chosen if name in settings or name in flags}
    return replace(run, settings=settings, flags=flags, changed=run.changed | written)
