"""The configuration that the baseline recommends: is it still good."""

import numpy as np
from pydantic import ValidationError

from contactlab.compare.checks import Subject, made
from contactlab.compare.compared import Compared
from contactlab.compare.verdicts import BETTER, CHANGED, SAME, WORSE
from contactlab.compare.wording import settings, share
from contactlab.errors import ContactlabError
from contactlab.schema import Check, Configuration, TradeoffReport
from contactlab.store import Store
from contactlab.tradeoff import tradeoff

_FASTER = 0.15
"""Below this share stored times, of two sessions of one machine, cannot be told apart."""


def recommendation_check(compared: Compared) -> Check:
    """Return whether what `contactlab tradeoff` recommends by the baseline still holds.

    It does as long as it is feasible in the candidate and nothing feasible is clearly cheaper
    there; both by the candidate's own times.
    """
    subject = Subject(
        "same recommendation",
        "recommendation",
        compared.policy.recommendation.changed,
        two_sided=True,
    )
    before, after = (_weighed(side.store) for side in (compared.baseline, compared.candidate))
    code, text = _verdict(before, after)
    return made(subject, np.full(1, code, dtype=np.int8), text, runs=0)


def _verdict(before: TradeoffReport | None, after: TradeoffReport | None) -> tuple[int, str]:
    if before is None or after is None or before.recommendation is None:
        if after is None or after.recommendation is None:
            return SAME, "neither store recommends a configuration"
        return BETTER, f"now recommends {settings(after.recommendation.configuration)}"
    told = settings(before.recommendation.configuration) or "the only configuration"
    if after.recommendation is None:
        return WORSE, f"{told} is not feasible any more, and nothing else is"
    now = settings(after.recommendation.configuration)
    found = _of(after, before.recommendation.configuration)
    if found is None or not found.feasible or found.time is None:
        return WORSE, f"{told} is not feasible any more; now recommends {now}"
    spared = 1 - after.recommendation.time / found.time
    if spared > _FASTER:
        return CHANGED, f"{now} takes {share(spared)} less time than {told}"
    return SAME, told


def _of(report: TradeoffReport, values: object) -> Configuration | None:
    return next((each for each in report.configurations if each.configuration == values), None)


def _weighed(store: Store) -> TradeoffReport | None:
    try:
        return tradeoff(store)
    except (ContactlabError, ValidationError):
        # Nothing to weigh by was measured, or the sweep is of another version of contactlab.
        return None
