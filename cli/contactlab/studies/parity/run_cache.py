"""Stored comparisons of runs, so that an interrupted study can be resumed."""

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
from contactlab.store.row_journal import end_torn_line, read_lines, with_checksum
from contactlab.studies.parity.parity_report import RunParity

NAME = "runs.jsonl"


class ComparedRun(NamedTuple):
    """Result of a run, and the errors of both engines against the closed form, NaN without one."""

    run: RunParity
    errors: tuple[float, float]


@dataclass(frozen=True)
class RunCache:
    """Compared runs in a file, one line each, by a key of everything that decides the result.

    A folder can serve several engines. Results of other code or versions are ignored.

    Attributes:
        folder: folder of the file; None to store nothing.
        decided_by: other parts of the key: engine, versions, device, rules.
    """

    folder: Path | None
    decided_by: Sequence[object]

    @cached_property
    def _deciding_values(self) -> list[object]:
        code = hash_of_packages(["contactlab"], ADAPTERS), *map(str, loaded_plugins())
        return [*code, *self.decided_by]

    def key(self, ours: str, theirs: str) -> str:
        """Return the key of a run, from its ids for MuJoCo and for the engine."""
        return hashlib.sha256(to_json([*self._deciding_values, ours, theirs])).hexdigest()[:32]

    def find(self, keys: Mapping[str, str]) -> dict[str, ComparedRun]:
        """Return the stored runs by run id, for keys by run id."""
        if self.folder is None:
            return {}
        ids_by_key = {key: run_id for run_id, key in keys.items()}
        return {
            ids_by_key[line["key"]]: ComparedRun(
                RunParity.model_validate(line["run"]), tuple(line["errors"])
            )
            for line in read_lines(self.folder / NAME)
            if line.get("key") in ids_by_key
        }

    def add(self, key: str, compared: ComparedRun) -> None:
        """Add a run; raise an OutputError if it cannot be written."""
        if self.folder is None:
            return
        line = {"key": key, "run": compared.run.model_dump(), "errors": compared.errors}
        path = self.folder / NAME
        with write_errors(path):
            self.folder.mkdir(parents=True, exist_ok=True)
            end_torn_line(path)
            with path.open("ab") as file:
                file.write(with_checksum(to_json(line, inf_nan_mode="constants")))
