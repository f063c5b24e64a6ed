"""Ids of runs: hashes of a JSON text with sorted keys that says all that a run is.

The runs of one row differ only in their seed, which stands between two parts of the text that they
share.
"""

import hashlib
import json
import math
from collections.abc import Collection, Iterable, Sequence
from functools import cache
from typing import cast

from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.effects import EFFECTS, RunState
from contactlab.scene.model_fields import is_as_written
from contactlab.scene.model_options import FLAGS, non_default
from contactlab.scene.resolution import ResolvedRun

ID_BYTES = 8


class RunIdentity:
    """What the ids of runs share that differ only in some settings and in their seeds.

    Args:
        base: their structure, with all effects.
        run: one of them.
        scene: hash of the scene's files.
        varying: settings and initial values in which they differ.
    """

    def __init__(
        self, base: CompiledScene, run: ResolvedRun, scene: str, varying: Collection[str] = ()
    ) -> None:
        flags = non_default(run.flags) | other_effects(base, run)
        first = _json({"duration": run.duration, "flags": flags, "scene": scene})
        self._head = f'{first[:-1]},"seed":'
        self._written_over = _json(sorted(run.changed & base.nonuniform))
        # Entries in the order of their names; every second piece is left empty for one that varies.
        self._pieces = [""]
        values = run.values
        for name in sorted(values):
            if name in varying:
                self._pieces += ["", ""]
            else:
                self._pieces[-1] += id_entry(base, name, values[name])

    def digests(self, entries: Sequence[str], seeds: Iterable[int]) -> bytes:
        """Return the ids of runs, `ID_BYTES` each.

        Args:
            entries: from `id_entry`, of what varies, in the order of their names.
            seeds: of the runs.
        """
        pieces = self._pieces.copy()
        pieces[1::2] = entries
        settings = "".join(pieces)[1:]
        tail = f',"settings":{{{settings}}},"written_over":{self._written_over}}}'
        return b"".join([_digest(f"{self._head}{seed}{tail}") for seed in seeds])


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode()).digest()[:ID_BYTES]


def id_entry(base: CompiledScene, name: str, value: object) -> str:
    """Return the entry of one setting, after a comma; empty if it equals the model as written."""
    if name not in base.settings and is_as_written(base.model, name, value):
        return ""
    return f",{_name(name)}:{_value(value)}"


@cache
def _name(name: str) -> str:
    return json.dumps(name)


def _value(value: object) -> str:
    """Return a value as JSON, rounded to 12 digits, since machines may differ in the last ones."""
    if isinstance(value, tuple):
        return f"[{','.join([_value(part) for part in cast('tuple[object, ...]', value)])}]"
    if isinstance(value, float):
        value = float(f"{value:.12g}")
        # The same text as the encoder's, ten times as fast.
        return repr(value) if math.isfinite(value) else _json(value)
    return _json(value)


def _json(value: object) -> str:
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def other_effects(base: CompiledScene, run: ResolvedRun) -> dict[str, bool]:
    """Return the requested effects that no flag or setting carries, where they change the run.

    What is left out because it provably changes nothing is not part of a run's identity.
    """
    written = RunState(base.model, base.facts, straight=False)
    names = run.effect_request.requested.keys() & run.changed - set(FLAGS) - run.settings.keys()
    return {
        name: run.effect_request.requested[name]
        for name in sorted(names)
        if "condim" in run.changed
        or EFFECTS[name].switch.is_on(written) != run.effect_request.requested[name]
    }
