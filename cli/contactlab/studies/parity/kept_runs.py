"""Runs that a comparison is done with, so that one that was interrupted goes on."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from pydantic_core import to_json

from contactlab.plugins import hash_of_packages, loaded_plugins
from contactlab.resources import ADAPTERS
from contactlab.store.atomic_files import write_errors
from contactlab.store.row_journal import end_torn_line, read_lines, sealed
from contactlab.studies.parity.parity_report import RunParity

NAME = "runs.jsonl"


class ComparedRun(NamedTuple):
    """What is said of a run, and how far both are from the scene's closed form, NaN without one."""

    run: RunParity
    errors: tuple[float, float]


@dataclass(frozen=True)
class KeptRuns:
    """Runs in a file of a folder, a line each, by a key of all that decides what is said of them.

    So a folder serves several engines, and what other code or versions said is passed over.

    Attributes:
        folder: where they are kept; None if they are not.
        decided_by: what decides beside a run itself: engine, versions, device, rules.
    """

    folder: Path | None
    decided_by: Sequence[object]

    @cached_property
    def _decided(self) -> list[object]:
        code = hash_of_packages(["contactlab"], ADAPTERS), *map(str, loaded_plugins())
        return [*code, *self.decided_by]

    def key(self, ours: str, theirs: str) -> str:
        """Return the key of a run by its ids, as it is for MuJoCo and for the engine."""
        return hashlib.sha256(to_json([*self._decided, ours, theirs])).hexdigest()[:32]

    def found(self, keys: Mapping[str, str]) -> dict[str, ComparedRun]:
        """Return the runs that are kept, by run id, of those with these keys by run id."""
        if self.folder is None:
            return {}
        wanted = {key: run_id for run_id, key in keys.items()}
        return {
            wanted[line["key"]]: ComparedRun(
                RunParity.model_validate(line["run"]), tuple(line["errors"])
            )
            for line in read_lines(self.folder / NAME)
            if line.get("key") in wanted
        }

    def keep(self, key: str, compared: ComparedRun) -> None:
        """Add a run; raise an OutputError if it cannot be written."""
        if self.folder is None:
            return
        line = {"key": key, "run": compared.run.model_dump(), "errors": compared.errors}
        path = self.folder / NAME
        with write_errors(path):
            self.folder.mkdir(parents=True, exist_ok=True)
            end_torn_line(path)
            with path.open("ab") as file:
                file.write(sealed(to_json(line, inf_nan_mode="constants")))
