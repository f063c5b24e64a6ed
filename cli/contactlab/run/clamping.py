"""Where the engine's safety of solref silently changes a model with the timestep."""

from collections.abc import Iterable, Mapping, Sequence

from contactlab.scene import ResolvedRun
from contactlab.schema import SolrefRule

_EQUAL = 1e-9


def is_clamped(run: ResolvedRun, solrefs: Iterable[Sequence[float]]) -> bool:
    """Return whether refsafe raises any of these time constants to two timesteps.

    Args:
        run: the run; its switch refsafe decides.
        solrefs: in either form; one in direct form has no time constant.
    """
    if not run.flags["refsafe"]:
        return False
    return any(raises(solref, run.timestep) for solref in solrefs)


def raises(solref: Sequence[float], timestep: float) -> bool:
    """Return whether refsafe raises the time constant of a solref to two timesteps."""
    return 0 < solref[0] < 2 * timestep


def solref_rules(runs: Mapping[str, ResolvedRun]) -> dict[str, SolrefRule | None]:
    """Return, for each run, how solref goes with the timestep among runs that else are equal.

    It is tied where the time constant is one multiple of every timestep, else absolute; None where
    the timestep does not vary.
    """
    groups: dict[str, list[str]] = {}
    for name, run in runs.items():
        groups.setdefault(_beside_contact(run), []).append(name)
    found: dict[str, SolrefRule | None] = {}
    for names in groups.values():
        found |= dict.fromkeys(names, _rule(runs, names))
    return found


def _beside_contact(run: ResolvedRun) -> str:
    values = {name: each for name, each in run.values.items() if name not in ("timestep", "solref")}
    return repr((sorted(values.items()), sorted(run.flags.items()), run.seed, run.duration))


def _rule(runs: Mapping[str, ResolvedRun], names: Sequence[str]) -> SolrefRule | None:
    timesteps = {runs[name].timestep for name in names}
    if len(timesteps) == 1:
        return None
    multiples = [_time_constant(runs[name]) / runs[name].timestep for name in names]
    least, most = min(multiples), max(multiples)
    return "tied" if least > 0 and most - least <= _EQUAL * most else "absolute"


def _time_constant(run: ResolvedRun) -> float:
    solref = run.settings.get("solref")
    return float(solref[0]) if isinstance(solref, tuple) else 0.0
