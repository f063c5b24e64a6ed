"""Evidence that the fixture gives to a test: a recorder, and assertions about its record."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco

from contactlab.commands.compare import compare
from contactlab.errors import ContactlabError, OutputError, suggestion
from contactlab.loop.recording import Recording, record
from contactlab.measure import labels_with
from contactlab.page.report_files import write_page
from contactlab.printable import shell_word
from contactlab.scene.scene_source import MANIFEST, read_manifest
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import write_baseline

_STABLE_LABEL = "stable"
_DECLARATION_HINT = (
    'record with scene={"subject": "mug", "hold": {"from": 1.0, "relative_to": "hand"}}, which '
    "declares the held body, its holder and the start of the hold"
)


class ContactEvidence:
    """Records a loop of a test, and judges it.

    Each statement ends the recording. It is true, or raises an AssertionError with the episode, its
    label, the reason, the step, and the place of its evidence.

    Attributes:
        folder: the store.
    """

    def __init__(self, folder: Path, *, update: bool = False) -> None:
        self.folder, self._update = folder, update
        self._recording: Recording | None = None

    def record(self, model: mujoco.MjModel, data: mujoco.MjData, **how: Any) -> Recording:  # noqa: ANN401
        """Record a loop like `contactlab.record`, in the test's own store."""
        __tracebackhide__ = True
        if self._recording is not None:
            raise OutputError("a test records once; more episodes go into the same recording")
        self._recording = record(model, data, self.folder, fresh=True, **how)
        return self._recording

    def stable(self) -> bool:
        """State that every episode was recorded completely, and has no label."""
        __tracebackhide__ = True
        self._raise_faults(
            _episode_faults(episode)
            for episode in self._finished_episodes()
            if episode.label != _STABLE_LABEL or episode.status != "ok"
        )
        return True

    def held(self, subject: str, by: str) -> bool:
        """State that every episode held a body as declared in its recording."""
        __tracebackhide__ = True
        episodes = self._finished_episodes()
        manifest = read_manifest(self._open_store().scene_folder / MANIFEST)
        hold = manifest.hold
        if hold is None or (manifest.subject, hold.relative_to or "world") != (subject, by):
            declared = [] if hold is None else [str(manifest.subject), hold.relative_to or "world"]
            near = [suggestion(name, declared) for name in (subject, by) if name not in declared]
            hint = next(filter(None, near), _DECLARATION_HINT)
            raise AssertionError(f"no declaration says when {by} should hold {subject}; {hint}")
        self._raise_faults(_missed_hold(episode) for episode in episodes)
        return True

    def within(self, baseline: str | Path) -> bool:
        """State that no episode is worse than in a baseline.

        With `--contact-baseline update`, the recorded evidence becomes the baseline instead.
        """
        __tracebackhide__ = True
        self._finished_episodes()
        place = Path(baseline)
        if self._update:
            write_baseline(self.folder, place)
            return True
        if not place.exists():
            raise AssertionError(
                f"there is no baseline {place}; accept this evidence with "
                "--contact-baseline update, and commit it"
            )
        compared = compare(place, self.folder, match="axes")
        failing = [check for check in compared.findings if check.outcome == "failed"]
        lines = [f"{compared.headline} (against {place})"]
        lines += [
            f"  {check.name}: {check.verdict} in {check.failing} of {check.judged}"
            for check in failing
        ]
        self._raise_faults(["\n".join(lines)] if compared.exit_code else [])
        return True

    def close(self) -> None:
        """End the recording, like its `with` block."""
        if self._recording is not None:
            self._recording.close()

    def _open_store(self) -> Store:
        return Store.open(self.folder)

    def _finished_episodes(self) -> list[EvidenceRecord]:
        __tracebackhide__ = True
        if self._recording is None:
            raise AssertionError(
                "nothing was recorded; begin with contact_evidence.record(model, data)"
            )
        self.close()
        return list(self._open_store().records())

    def _raise_faults(self, faults: Any) -> None:  # noqa: ANN401 - any strings
        __tracebackhide__ = True
        wrong = [fault for fault in faults if fault]
        if wrong:
            raise AssertionError("\n".join([*wrong, *self._evidence_places()]))

    def _evidence_places(self) -> Iterator[str]:
        yield f"store: {self.folder}  (contactlab show {shell_word(self.folder)})"
        page = self.folder.with_name(f"{self.folder.name}.html")
        try:
            write_page(self._open_store(), page)
            yield f"page: {page.absolute().as_uri()}"
        except ContactlabError as error:
            yield f"page: none, since {error}"


def _episode_faults(episode: EvidenceRecord) -> str:
    name = f"episode {episode.seed} (run {episode.run_id[:8]})"
    ended = [] if episode.status == "ok" else [f"{name} {episode.status}: {episode.status_reason}"]
    labels = (label for label in episode.labels if label.label != _STABLE_LABEL)
    label_texts = [
        f"{name} is {label.label} at step {label.step}: {label.reason}" for label in labels
    ]
    return "\n".join([*ended, *label_texts])


def _missed_hold(episode: EvidenceRecord) -> str:
    name = f"episode {episode.seed} (run {episode.run_id[:8]})"
    if episode.metrics["hold_contact"] is None:
        return f"{name} ended after {episode.duration:g} s, before the start of the hold"
    labels = [label for label in episode.labels if label.label in labels_with("grip")]
    return "\n".join(
        f"{name} is {label.label} at step {label.step}: {label.reason}" for label in labels
    )
