"""Where MuJoCo's `refsafe` changes solref silently, with the timestep."""

from collections.abc import Iterable, Mapping, Sequence

from contactlab.scene.resolution import ResolvedRun
from contactlab.schema.evidence import SolrefRule

_EQUAL = 1e-9


def is_clamped(run: ResolvedRun, solrefs: Iterable[Sequence[float]]) -> bool:
    """Return whether refsafe, if on, raises any of these time constants to two timesteps.

    A solref in direct form has none.
    """
    if not run.flags["refsafe"]:
        return False
    return any(raises_solref(solref, run.timestep) for solref in solrefs)


def raises_solref(solref: Sequence[float], timestep: float) -> bool:
    """Return whether refsafe raises the time constant of a solref to two timesteps [s]."""
    return 0 < solref[0] < 2 * timestep


def solref_rules(runs: Mapping[str, ResolvedRun]) -> dict[str, SolrefRule | None]:
    """Return how solref goes with the timestep among runs that are equal otherwise, by run id.

    It is tied where the time constant is the same multiple of every timestep, else absolute; None
    where the timestep does not vary.
    """
    groups: dict[str, list[str]] = {}
    for run_id, run in runs.items():
        values = {name: run.values[name] for name in run.values.keys() - {"timestep", "solref"}}
        shared = (sorted(values.items()), sorted(run.flags.items()), run.seed, run.duration)
        groups.setdefault(repr(shared), []).append(run_id)
    found: dict[str, SolrefRule | None] = {}
    for run_ids in groups.values():
        found |= dict.fromkeys(run_ids, _rule([runs[run_id] for run_id in run_ids]))
    return found


def _rule(runs: Sequence[ResolvedRun]) -> SolrefRule | None:
    if len({run.timestep for run in runs}) == 1:
        return None
    solrefs = [run.settings.get("solref") for run in runs]
    multiples = [
        float(solref[0]) / run.timestep if isinstance(solref, tuple) else 0.0
        for run, solref in zip(runs, solrefs, strict=True)
    ]
    least, most = min(multiples), max(multiples)
    return "tied" if least > 0 and most - least <= _EQUAL * most else "absolute"
