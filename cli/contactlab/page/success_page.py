"""The page of a study of successes: its headline, a film of a lost success, and its tables."""

from contactlab.page.header_films import Films, Moment, film_of_moment
from contactlab.page.page_template import fill_template
from contactlab.printable import shell_word, visible
from contactlab.rendering.html import render_html
from contactlab.resources import read_style
from contactlab.schema.success import SuccessReport
from contactlab.store.finished_store import Store
from contactlab.studies.success.success_document import describe_success, headline_of


def success_page(report: SuccessReport, store: Store) -> str:
    """Return the page of a report on the episodes of a store, which needs no other file.

    It has a film of the moment when a lost success parts from the one as written, next to it, or
    of the moment when a contact fails.
    """
    moment = _find_moment(report)
    return fill_template(
        "success.html",
        title=visible(f"Is the success physical? {report.source}"),
        headline=headline_of(report),
        lost=report.written.good > report.physical.good,
        films=film_of_moment(store, moment) if moment else Films([]),
        body=render_html(describe_success(report, headed=False)),
        store=shell_word(report.store),
        style=read_style("page"),
    )


def _find_moment(report: SuccessReport) -> Moment | None:
    body = report.objects[0] if report.objects else ""
    if parting := report.parting:
        words = f"left as written, a success that is not physical; right {parting.variant}, where "
        words += f"it is lost: they part at {parting.time:.2f} s"
        original, variant = parting.runs
        return Moment(original, body, parting.time, parting.time, words, variant)
    failing = [loss for loss in report.losses if loss.kind == "contact" and loss.time is not None]
    for loss in failing[:1]:
        assert loss.time is not None
        words = f"a success that is not physical: {loss.cause} at {loss.time:.2f} s"
        return Moment(loss.run, body, loss.time, loss.time, words)
    return None
