"""Whether successes are physical: the same episodes as written and under variants."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from contactlab.pareto.criteria import find_store
from contactlab.plan.grid import Plan
from contactlab.run.sweep_request import read_request
from contactlab.schema.success import EPISODES, OUTCOMES, SuccessReport
from contactlab.shares import anytime_interval
from contactlab.store.finished_store import Store
from contactlab.store.store_files import MANIFEST
from contactlab.studies.success.decisive_contacts import DecisiveContacts
from contactlab.studies.success.episode_choice import EpisodesUntilDecided
from contactlab.studies.success.episode_reader import EpisodeReader
from contactlab.studies.success.episode_table import EpisodeTable
from contactlab.studies.success.stored_successes import OUTCOMES_FILE, judge_store
from contactlab.studies.success.success_request import (
    SuccessRequest,
    read_requirement,
    sweep_of_episodes,
)
from contactlab.tasks.session import Session


def judge_successes(request: SuccessRequest, session: Session) -> SuccessReport:
    """Play the episodes of an environment, or read those of a store, and judge their successes.

    Raises a SceneError if there is no environment, or it fails; a SweepFileError for a wrong sweep
    or option; a StoreError if the episodes do not say how they ended; a StoppedError if the session
    was stopped.
    """
    for text in request.requirements:
        read_requirement(text)
    if Path(request.source).is_dir() and (stored := find_store(request.source)):
        return judge_store(request, Store.open(stored))
    sweep, folder, variants = sweep_of_episodes(request, session)
    target = session.folder / EPISODES
    sweep_request = read_request(
        sweep,
        EPISODES,
        target,
        folder=folder,
        workers=session.workers,
        drive=request.drive,
        allow_code=session.allow_code,
    )
    contacts = DecisiveContacts(sweep_request.scene.base({}), request.objects, request.depth_limit)
    numerics = [each.name for each in variants if each.kind == "numerics"]
    control = next((each.name for each in variants if each.kind == "control"), None)
    costly_rate = 4  # steps for each step as written
    costly = [each.name for each in variants if each.rate >= costly_rate]
    reader = EpisodeReader(contacts, target, numerics)

    chosen: EpisodesUntilDecided | None = None

    def choose_episodes(plan: Plan, ids: NDArray[np.uint64]) -> EpisodesUntilDecided:
        nonlocal chosen
        chosen = EpisodesUntilDecided(
            plan, ids, reader.read_table, lambda table: is_decided(request, table), control, costly
        )
        return chosen

    # A finished store may have been stopped by another question.
    fresh = (target / MANIFEST).exists()
    store = session.run(replace(sweep_request, choose=choose_episodes, fresh=fresh))
    assert chosen is not None
    unrecorded = OUTCOMES_FILE.dump_json([*chosen.iterate_unrecorded()], indent=1)
    session.write({OUTCOMES: unrecorded.decode() + "\n"})
    cases = sweep_request.plan.count // (1 + len(variants))
    return judge_store(request, store, planned_cases=cases)


def is_decided(request: SuccessRequest, table: EpisodeTable) -> bool:
    """Return whether all questions are answered, however often one looks."""
    if not request.stops_early:
        return False
    cases = len(table.cases)
    counts = {"success": table.count_successes(), "physical": table.count_physical()}
    ends = {name: anytime_interval(good, cases) for name, good in counts.items()}
    for text in request.requirements:
        quantity, least = read_requirement(text)
        low, high = ends[quantity]
        if low < least <= high:
            return False
    widest = max(high - low for low, high in ends.values()) / 2
    return request.precision is None or widest <= request.precision
