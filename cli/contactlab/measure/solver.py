"""Metrics of the solver's work and of the contacts it was given."""

import numpy as np
from numpy.typing import NDArray

from contactlab.contact import Floats
from contactlab.measure.context import Context, shared
from contactlab.measure.metric import Metric


@shared
def saturated(context: Context) -> NDArray[np.bool_]:
    """Return (n, N) whether the solver used all the iterations that it may."""
    return context.trace.iterations_most >= context.setup.iterations[:, None]


def _iterations_mean(context: Context) -> Floats:
    return context.trace.iterations.mean(axis=1)


def _iterations_max(context: Context) -> Floats:
    return context.trace.iterations_most.max(axis=1).astype(np.float64)


def _iterations(context: Context) -> Floats:
    return context.trace.iterations.sum(axis=1).astype(np.float64)


def _saturated_share(context: Context) -> Floats:
    return saturated(context).mean(axis=1)


def _contacts_mean(context: Context) -> Floats:
    return context.trace.contacts.mean(axis=1)


def _contacts_max(context: Context) -> Floats:
    return context.trace.contacts.max(axis=1).astype(np.float64)


@shared
def cut_by_pair(context: Context) -> list[NDArray[np.bool_]]:
    """Return for each graded pair (n, N) where it had more contacts than slots."""
    slots = context.setup.slots
    return [folded.found > most for folded, most in zip(context.folded, slots, strict=True)]


def _contacts_cut(context: Context) -> Floats:
    nowhere = np.zeros(context.trace.contacts.shape, dtype=np.bool_)
    cut = np.logical_or.reduce([nowhere, *cut_by_pair(context)])
    return cut.sum(axis=1).astype(np.float64)


def _ungraded_contacts(context: Context) -> Floats:
    graded = sum((folded.found for folded in context.folded), np.zeros_like(context.trace.contacts))
    return (context.trace.contacts > graded).sum(axis=1).astype(np.float64)


SOLVER = (
    Metric(
        "solver_iterations_mean",
        "1",
        "lower",
        0,
        1,
        "Solver iterations a step, summed over contact islands, averaged over the run.",
        _iterations_mean,
    ),
    Metric(
        "solver_iterations_max",
        "1",
        "lower",
        0,
        1,
        "Most solver iterations that one contact island took in one step.",
        _iterations_max,
    ),
    Metric(
        "solver_iterations",
        "1",
        "lower",
        0,
        1,
        "Solver iterations of the whole run, over all contact islands.",
        _iterations,
    ),
    Metric(
        "saturated_share",
        "1",
        "lower",
        0,
        1,
        "Share of steps in which an island used as many iterations as the solver may. Alone it is "
        "no failure: an easy scene with one iteration allowed reaches the limit and converges.",
        _saturated_share,
    ),
    Metric(
        "contacts_mean",
        "1",
        "none",
        0,
        1,
        "Contacts in the whole model, averaged over the run.",
        _contacts_mean,
    ),
    Metric(
        "contacts_max",
        "1",
        "none",
        0,
        1,
        "Most contacts in the whole model at any step.",
        _contacts_max,
    ),
    Metric(
        "contacts_cut",
        "1",
        "lower",
        0,
        1,
        "Steps in which a graded pair had more contacts than slots, so that some went unrecorded.",
        _contacts_cut,
    ),
    Metric(
        "ungraded_contacts",
        "1",
        "none",
        0,
        1,
        "Steps in which the model had contacts outside the graded pairs.",
        _ungraded_contacts,
    ),
)
