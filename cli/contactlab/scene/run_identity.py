"""What a run is: the text whose hash is its id.

The text is JSON with sorted keys. Of the runs of one row only the seed differs, which stands
between two parts that are the same for all of them.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from functools import cache
from typing import cast

from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.effects import EFFECTS, RunState
from contactlab.scene.engine_flags import FLAGS, non_default
from contactlab.scene.model_fields import is_as_written
from contactlab.scene.resolved import ResolvedRun

ID_BYTES = 8


def digest(head: str, seed: int, tail: str) -> bytes:
    """Return the id of a run as bytes, from what stands before and after its seed."""
    return hashlib.sha256(f"{head}{seed}{tail}".encode()).digest()[:ID_BYTES]


def head_of(base: CompiledScene, run: ResolvedRun, scene: str) -> str:
    """Return what stands before the seed.

    Args:
        base: the run's structure, with all effects.
        run: the run.
        scene: hash of the scene's files.
    """
    flags = non_default(run.flags) | other_effects(base, run)
    first = _json({"duration": run.duration, "flags": flags, "scene": scene})
    return f'{first[:-1]},"seed":'


def tail_of(entries: Iterable[str], written_over: str) -> str:
    """Return what stands behind the seed.

    Args:
        entries: of the settings that count, in the order of their names; empty texts are left out.
        written_over: what `written_over_of` returns.
    """
    return f',"settings":{{{"".join(entries)[1:]}}},{written_over}}}'


def written_over_of(base: CompiledScene, run: ResolvedRun) -> str:
    """Return the last entry: settings written over pairs that have them differently."""
    return f'"written_over":{_json(sorted(run.changed & base.nonuniform))}'


def entries_of(base: CompiledScene, values: Mapping[str, object]) -> dict[str, str]:
    """Return the entry of each value, in the order of their names; empty if it does not count."""
    return {name: entry(base, name, values[name]) for name in sorted(values)}


def entry(base: CompiledScene, name: str, value: object) -> str:
    """Return the entry of one setting with a comma before it; empty if it does not count."""
    if name not in base.settings and is_as_written(base.model, name, value):
        return ""
    return f",{_name(name)}:{_value(value)}"


@cache
def _name(name: str) -> str:
    return json.dumps(name)


def _value(value: object) -> str:
    """Return a value as JSON, without the digits in which machines may differ."""
    if isinstance(value, tuple):
        return f"[{','.join([_value(part) for part in cast('tuple[object, ...]', value)])}]"
    if isinstance(value, float):
        value = float(f"{value:.12g}")
        # What the encoder writes of it, ten times as fast.
        return repr(value) if math.isfinite(value) else _json(value)
    return _json(value)


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def other_effects(base: CompiledScene, run: ResolvedRun) -> dict[str, bool]:
    """Return the effects asked for that no switch or setting holds, if that changes anything.

    What is left out because it provably changes nothing is no part of what a run is.
    """
    written = RunState(base.model, base.facts, straight=False)
    names = run.effect_request.asked.keys() & run.changed - set(FLAGS) - run.settings.keys()
    return {
        name: run.effect_request.asked[name]
        for name in sorted(names)
        if "condim" in run.changed or EFFECTS[name].is_on(written) != run.effect_request.asked[name]
    }
