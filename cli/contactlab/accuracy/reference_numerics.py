"""Which settings only discretise a model, and which are part of the model itself.

What only discretises shares the limit of small timesteps, and so a reference; all other settings
change what the limit is: contact parameters (solref, solimp, friction, condim, margin, gap), cone
and impratio, gravity and the like, and what the manifest sets. Of settings that look numerical,
these are part of the model:

- noslip_iterations, noslip_tolerance: the pass takes slip away that the contact model has; what
  is left depends on how far it goes, at any timestep.
- refsafe: without it solref is what it says at any timestep; with it only where the timestep is
  small enough, which is an error of the run, and is marked as `solref_clamped`.
- multiccd, nativeccd, speculative, diagexact: these make other contacts, or other impedances.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from contactlab.scene.resolution import ResolvedRun
from contactlab.scene.setting_values import Settings


@dataclass(frozen=True)
class NumericSetting:
    """A setting or a switch that only discretises.

    Attributes:
        reference: what a reference has; None for what each reference chooses.
        reason: why its limit does not depend on it.
    """

    reference: object
    reason: str


_SOLVED = "the constraint problem is convex: solved to the end, every way gives one answer"
_TOUCH = "how closely the distance of convex shapes is found"
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
        "ccd_iterations": NumericSetting(200, _TOUCH),
        "ccd_tolerance": NumericSetting(1e-9, _TOUCH),
        "warmstart": NumericSetting(True, "where the solver starts; " + _SOLVED),
        "island": NumericSetting(True, "bodies that do not touch are solved apart; " + _SOLVED),
        "midphase": NumericSetting(True, "how pairs that are far apart are left out"),
        "eulerdamp": NumericSetting(True, "damping taken at the end of a step or at its start"),
        "sleep": NumericSetting(False, "leaves out bodies at rest, which should not move anyway"),
    }
)


def with_reference_numerics(run: ResolvedRun, integrator: str, timestep: float) -> ResolvedRun:
    """Return a run's model and start with the numerics of a reference.

    Runs that differ in nothing but numerics give equal references.

    Args:
        run: the run.
        integrator: of the reference.
        timestep: of the reference [s].
    """
    chosen = {name: each.reference for name, each in NUMERICS.items()}
    chosen |= {"integrator": integrator, "timestep": timestep}
    settings = Settings({name: chosen.get(name, value) for name, value in run.settings.items()})
    flags = {name: bool(chosen.get(name, state)) for name, state in run.flags.items()}
    written = {name for name in chosen if name in settings or name in flags}
    return replace(run, settings=settings, flags=flags, changed=run.changed | written)
