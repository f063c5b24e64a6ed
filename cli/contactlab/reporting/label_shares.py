"""Shares of a store's runs in words, with their confidence interval if runs are draws."""

from collections.abc import Callable

from contactlab.judge.wording import share_with_interval
from contactlab.rendering.amounts import format_percent
from contactlab.reporting.report_columns import STABLE, RunLabels
from contactlab.store.finished_store import Store

ShareWords = Callable[[int, int], str]


def share_words(store: Store) -> ShareWords:
    """Return a function that writes a share of runs: `80 %`, or `80 % (58 to 92 %)`.

    If runs are draws of axes or seeds, it has Wilson's interval of 95 %. The share of the cells of
    a grid is exact.
    """
    sweep = store.sweep
    return share_with_interval if sweep.is_drawn else exact_share


def exact_share(good: int, runs: int) -> str:
    """Return `80 %`, the share of a complete set of runs."""
    return format_percent(good / runs)


def stable_share(labels: RunLabels, share: ShareWords) -> str:
    """Return the share of stable runs in a sentence; empty if runs are not draws."""
    if share is exact_share or not len(labels.codes):
        return ""
    stable = dict(zip(labels.names, labels.counts, strict=True)).get(STABLE, 0)
    return f"{share(stable, len(labels.codes))} are stable, with 95 % if runs are independent draws"
