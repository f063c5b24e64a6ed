"""Judges the episodes of a finished store: shares, losses, variants, and where two part."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from contactlab.errors import StoreError
from contactlab.rendering.amounts import format_amount
from contactlab.run.planned_runs import stored_sweep_scene
from contactlab.scene.variants import AS_WRITTEN, Variant, load_variants
from contactlab.schema.drive import PolicyDrive, drive_text
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.setting_values import as_number
from contactlab.schema.success import (
    OUTCOMES,
    DecisivePair,
    Parting,
    PlayedEpisode,
    SuccessLoss,
    SuccessReport,
    SuccessRequirement,
    SuccessShare,
    VariantResult,
)
from contactlab.schema.vocabulary import VARIANT
from contactlab.shares import (
    SURE,
    anytime_interval,
    paired_chance,
    paired_difference,
    runs_to_decide,
    wilson_interval,
)
from contactlab.store.finished_store import Store
from contactlab.store.store_files import read_stored
from contactlab.studies.success.decisive_contacts import DecisiveContacts
from contactlab.studies.success.episode_choice import FIRST_BLOCK, case_of
from contactlab.studies.success.episode_reader import played_episode
from contactlab.studies.success.episode_table import Case, Episode, EpisodeTable
from contactlab.studies.success.parting import find_parting
from contactlab.studies.success.success_request import SuccessRequest, read_requirement

_NOT_REPEATED = (
    "whether a success survives another step, cone, solver or softness: recorded episodes are not "
    "played again"
)
OUTCOMES_FILE = TypeAdapter(list[PlayedEpisode])
"""Reads and writes the file of outcomes next to a store."""
_NOT_VARIED = "how often it succeeds with other friction, mass, latency and noise"


def judge_store(
    request: SuccessRequest, store: Store, planned_cases: int | None = None
) -> SuccessReport:
    """Return the report of the episodes of a store, of `planned_cases` if more were planned.

    Raises a StoreError if they do not say how they ended.
    """
    judge = _StoreJudge(request, store)
    table, contacts = judge.table, judge.contacts
    cases = len(table.cases)
    if not cases:
        raise StoreError(f"{store.address}: no episode was played: {judge.first_problem}")
    good, physical = table.count_successes(), table.count_physical()
    lost = good - physical
    low, high = paired_difference(0, lost, cases)
    chance = paired_chance(0, lost)
    needed = None
    if lost and chance > 1 - SURE:
        # As many losses as McNemar's exact test needs, at the same rate.
        enough = next(count for count in range(1, cases + 8) if paired_chance(0, count) <= 1 - SURE)
        needed = math.ceil(enough * cases / lost)
    shares = {"success": judge.share_of(good), "physical": judge.share_of(physical)}
    lacking = () if table.numerics else (_NOT_REPEATED,)
    lacking += () if any(each.kind == "robot" for each in judge.variants) else (_NOT_VARIED,)
    return SuccessReport(
        source=request.source,
        store=str(store.address),
        mujoco=store.manifest.sweep.engine.version,
        policy=judge.policy,
        objects=contacts.object_names,
        named=contacts.named,
        pairs=tuple(DecisivePair(pair=each.name, share=each.share) for each in contacts.pairs),
        depth_limit=request.depth_limit,
        written=shares["success"],
        sound=judge.share_of(sum(map(table.has_sound_contacts, table.cases))),
        physical=shares["physical"],
        difference=(low, min(high, 0.0)),
        chance=chance,
        losses=tuple(judge.list_losses()),
        variants=tuple(map(judge.compare_variant, judge.variants)),
        parting=judge.find_first_parting(),
        needed=needed,
        stop="decided"
        if planned_cases is not None and len(table.rows) < planned_cases
        else "all episodes",
        anytime=request.stops_early,
        requirements=tuple(decide_requirement(text, shares) for text in request.requirements),
        repeated=bool(table.numerics),
        not_checked=lacking,
        notes=tuple(judge.list_notes()),
    )


def decide_requirement(text: str, shares: dict[str, SuccessShare]) -> SuccessRequirement:
    """Return whether a required share is met, unmet or undecided by its interval."""
    quantity, least = read_requirement(text)
    share = shares[quantity]
    outcome = "met" if share.low >= least else "unmet" if share.high < least else "undecided"
    needed = runs_to_decide(share.share, least) if outcome == "undecided" else None
    return SuccessRequirement.model_validate(
        {"text": text, "quantity": quantity, "least": least, "outcome": outcome, "needed": needed}
    )


class _StoreJudge:
    def __init__(self, request: SuccessRequest, store: Store) -> None:
        self._request, self._store = request, store
        scene = stored_sweep_scene(store.manifest.sweep, store.scene_folder)
        self._base, self._scene = scene.base({}), scene
        records = sorted(store.records(), key=lambda each: each.index)
        if all(each.success is None for each in records):
            raise StoreError(
                f"{store.address}: no episode says how it ended. An environment says it by "
                "`success` or `is_success` in its infos, a loop by recording.reset(success=...)"
            )
        self.contacts = DecisiveContacts(self._base, request.objects, request.depth_limit)
        unrecorded = _read_unrecorded(store)
        originals = [each for each in records if _variant_of(each) == AS_WRITTEN]
        traced = [each for each in originals if each.trace is not None]
        self._untraced = len(originals) - len(traced)
        self.contacts.find_object([store.trace(each) for each in traced[:FIRST_BLOCK]])
        played = set(map(_variant_of, (*records, *unrecorded)))
        self.variants = [each for name, each in load_variants().items() if name in played]
        numerics = [each.name for each in self.variants if each.kind == "numerics"]
        self.table = EpisodeTable(numerics)
        self._records = {each.run_id: each for each in records}
        for each in records:
            case = case_of({**each.axes, "seed": each.seed})
            self.table.add_episode(case, _variant_of(each), self._read_episode(each))
        for each in unrecorded:
            case = case_of({**each.axes, "seed": each.seed})
            self.table.add_episode(case, _variant_of(each), played_episode(vars(each), None))

    def _read_episode(self, record: EvidenceRecord) -> Episode:
        contact = None
        if _variant_of(record) == AS_WRITTEN and record.success:
            trace = None if record.trace is None else self._store.trace(record)
            contact = self.contacts.judge_episode(record.labels, trace)
        return played_episode(vars(record), contact)

    @property
    def policy(self) -> str:
        drive = self._scene.drive.drive
        if isinstance(drive, PolicyDrive):
            return drive_text(drive).removeprefix("policy=")
        own = self._scene.source.environment
        return "random actions of its action_space" if own else "the recorded loop"

    @property
    def first_problem(self) -> str:
        episodes = (each for row in self.table.rows.values() for each in row.values())
        return next((each.problem for each in episodes if each.problem), "it says nothing")

    def share_of(self, good: int) -> SuccessShare:
        episodes = len(self.table.cases)
        low, high = (anytime_interval if self._request.stops_early else wilson_interval)(
            good, episodes
        )
        return SuccessShare(good=good, episodes=episodes, low=low, high=high)

    def list_losses(self) -> Iterator[SuccessLoss]:
        for cause, (episodes, alone) in self.table.count_losses().items():
            loss = SuccessLoss(cause=cause, kind="variant", episodes=episodes, alone=alone)
            yield loss if cause in self.table.numerics else self._add_example(loss)

    def _add_example(self, loss: SuccessLoss) -> SuccessLoss:
        originals = (row[AS_WRITTEN] for row in self.table.rows.values() if AS_WRITTEN in row)
        contacts = ((each.run_id, each.contact.causes) for each in originals if each.contact)
        run, cause = next(
            (run, causes[loss.cause]) for run, causes in contacts if loss.cause in causes
        )
        update = {"kind": "contact", "example": cause.reason, "run": run, "time": cause.time}
        return loss.model_copy(update=update)

    def compare_variant(self, variant: Variant) -> VariantResult:
        counts = self.table.count_outcomes(variant.name)
        gained, lost, pairs = counts.gained, counts.lost, counts.pairs
        episodes = (row[variant.name] for row in self.table.rows.values() if variant.name in row)
        problems = [each.problem for each in episodes if each.problem]
        share = None
        if pairs:
            low, high = wilson_interval(counts.good, pairs)
            share = SuccessShare(good=counts.good, episodes=pairs, low=low, high=high)
        return VariantResult(
            name=variant.name,
            kind=variant.kind,
            summary=variant.summary,
            success=share,
            gained=gained,
            lost=lost,
            difference=paired_difference(gained, lost, pairs) if pairs else None,
            chance=paired_chance(gained, lost) if pairs else None,
            problem=f"{len(problems)} not played, {problems[0]}" if problems else "",
        )

    def find_first_parting(self) -> Parting | None:
        # The variant is the one that takes most successes away.
        losses = [each.cause for each in self.list_losses() if each.kind == "variant"]
        if not losses:
            return None
        name = losses[0]
        case: Case = next(each for each in self.table.cases if name in self.table.find_losses(each))
        row = self.table.rows[case]
        original, variant = (self._records[row[each].run_id] for each in (AS_WRITTEN, name))
        if original.trace is None or variant.trace is None:
            return None
        traces = self._store.trace(original), self._store.trace(variant)
        pairs = [each.name for each in self.contacts.pairs]
        moment = find_parting(self._base.model, sorted(self.contacts.objects), traces, pairs)
        if moment is None:
            return None
        own = {key: value for key, value in original.axes.items() if key != VARIANT}
        return Parting(
            case={**own, "seed": original.seed},
            variant=name,
            time=moment.time,
            body=moment.body,
            distance=moment.distance,
            forces=moment.forces,
            runs=(original.run_id, variant.run_id),
        )

    def list_notes(self) -> Iterator[str]:
        originals = [row[AS_WRITTEN] for row in self.table.rows.values() if AS_WRITTEN in row]
        whole = [
            each
            for each in self._records.values()
            if _variant_of(each) == AS_WRITTEN and not each.success and _lasts_whole(each)
        ]
        if whole and self._scene.source.environment:
            duration = format_amount(whole[0].duration, "s")
            yield (
                f"{len(whole)} failures last the whole {duration} of an episode; "
                "--duration allows longer ones"
            )
        if failed := [each.problem for each in originals if each.problem]:
            yield f"{len(failed)} episodes as written were not played: {failed[0]}"
        if self._untraced:
            yield f"{self._untraced} episodes have no trace, so their depths are not known"
        for each in self.variants:
            counts = self.table.count_outcomes(each.name)
            if each.kind == "control" and counts.changed_outcomes:
                yield (
                    f"chance alone changes {counts.changed_outcomes} of {counts.pairs} outcomes "
                    f"({each.summary.partition(',')[0]}); do not blame a variant for about as many"
                )


def _read_unrecorded(store: Store) -> Sequence[PlayedEpisode]:
    if not isinstance(store.address, Path):
        return ()
    try:
        return OUTCOMES_FILE.validate_json(read_stored(store.address.parent, OUTCOMES) or b"[]")
    except ValidationError as error:
        raise StoreError(f"{store.address.parent / OUTCOMES} is damaged; remove it") from error


def _variant_of(record: EvidenceRecord | PlayedEpisode) -> str:
    return str(record.axes.get(VARIANT, AS_WRITTEN))


def _lasts_whole(record: EvidenceRecord) -> bool:
    timestep = as_number(record.settings["timestep"])
    return record.steps * timestep >= record.duration - timestep
