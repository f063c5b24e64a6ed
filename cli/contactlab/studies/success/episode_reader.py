"""Reads finished episodes into a table, while others are still played."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from contactlab.scene.variants import AS_WRITTEN
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.mcap.trace_reader import StoredTrace, read_trace
from contactlab.store.store_files import TRACES
from contactlab.studies.success.decisive_contacts import ContactVerdict, DecisiveContacts
from contactlab.studies.success.episode_choice import FIRST_BLOCK, FinishedEpisode
from contactlab.studies.success.episode_table import Episode, EpisodeTable

_PLAYED = ("ok", "stopped")  # statuses of episodes that were played; simulations may fail in them


class EpisodeReader:
    """Reads rows of episodes and the traces of those as written, each once.

    Args:
        contacts: finds the object in the first block of episodes, and judges its contacts.
        folder: the store, which is not finished yet.
        numerics: names of the variants that an outcome must not depend on.
    """

    def __init__(self, contacts: DecisiveContacts, folder: Path, numerics: Sequence[str]) -> None:
        self._contacts, self._folder, self._numerics = contacts, folder, numerics
        self._known = dict[str, Episode]()
        self._is_found = False

    def read_table(self, finished: Iterable[FinishedEpisode]) -> EpisodeTable:
        """Return the table of finished episodes."""
        rows = list(finished)
        if not self._is_found:
            first = [row for _, variant, row in rows if variant == AS_WRITTEN][:FIRST_BLOCK]
            self._contacts.find_object([trace for row in first if (trace := self._read_trace(row))])
            self._is_found = True
        table = EpisodeTable(self._numerics)
        for case, variant, row in rows:
            run_id = str(row["run_id"])
            if run_id not in self._known:
                contact = self._judge_contacts(row) if variant == AS_WRITTEN else None
                self._known[run_id] = played_episode(row, contact)
            table.add_episode(case, variant, self._known[run_id])
        return table

    def _judge_contacts(self, row: Mapping[str, Any]) -> ContactVerdict | None:
        trace = self._read_trace(row) if row.get("success") else None
        if trace is None:
            return None
        record = EvidenceRecord.model_validate_json(trace.record_json)
        return self._contacts.judge_episode(record.labels, trace)

    def _read_trace(self, row: Mapping[str, Any]) -> StoredTrace | None:
        run_id = str(row["run_id"])
        path = self._folder / TRACES / run_id[:2] / f"{run_id}.mcap"
        return read_trace(path, path) if path.exists() else None


def played_episode(row: Mapping[str, Any], contact: ContactVerdict | None) -> Episode:
    """Return the episode of a row of a table, or of a record as data, with its contacts.

    A simulation that failed is no success, unless the environment called it one before.
    """
    status, success = row["status"], row.get("success")
    if status not in _PLAYED:
        problem = f"{status}: {row.get('status_reason')}"
        return Episode(row["run_id"], success, problem, contact)
    failed = status == "stopped" and success is None
    return Episode(row["run_id"], False if failed else success, "", contact)
