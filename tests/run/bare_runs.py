"""Runs that nothing looks into."""

from contactlab.scene.effects.effect import EffectRequest
from contactlab.scene.run_spec import RunSpec


def bare_run(index: int, run_id: str) -> RunSpec:
    """Return a run of no scene, to be handed on."""
    request = EffectRequest({}, frozenset(), auto=False)
    return RunSpec(
        {}, {}, frozenset(), {}, {}, 0, 1.0, request, frozenset(), index=index, run_id=run_id
    )
