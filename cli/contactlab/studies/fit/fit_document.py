"""Describes the settings that explain recorded motion."""

from pathlib import Path

from contactlab.rendering.amounts import format_amount
from contactlab.rendering.document import Document, Headline, Sentence, document_of, table_of
from contactlab.schema.study_reports import FITTED, FitReport, FittedSetting


def describe_fit(report: FitReport, *, folder: Path | None = None) -> Document:
    """Describe a fit.

    Args:
        report: the fit.
        folder: of the written model, if it was written.
    """
    low, high = report.held_out_interval
    head = (
        f"{report.scene}: {report.metric} {format_amount(report.held_out_error)} "
        f"({format_amount(low)} to {format_amount(high)}) on {len(report.held_out)} held-out runs, "
        f"{format_amount(report.current_error)} as written; {format_amount(report.fitted_error)} "
        f"on {len(report.fitted_runs)} fitted runs"
    )
    noise = f"noise floor: {format_amount(report.noise_floor)}, by the start noise of the scene"
    most_named = 5
    worst = sorted(report.held_out.items(), key=lambda item: -item[1])[:most_named]
    largest_errors = ", ".join(f"run {run} ({format_amount(error)})" for run, error in worst)
    file_sentence = (
        f"wrote {folder / 'fitted' / FITTED}, after {report.runs:,} runs" if folder else ""
    )
    return document_of(
        [
            Headline(head),
            *([] if report.noise_floor is None else [Sentence(noise)]),
            table_of(
                ("setting", "fitted", "95 %", "identified"),
                list(map(_describe_setting_row, report.settings)),
            ),
            Sentence(f"largest errors: {largest_errors}"),
            *([Sentence(file_sentence)] if file_sentence else []),
        ]
    )


def _describe_setting_row(each: FittedSetting) -> tuple[object, ...]:
    interval = ""
    if each.interval:
        interval = " to ".join(map(format_amount, each.interval))
    identified_text = "yes" if each.identified else "no: the error does not depend on it"
    return each.name, each.value, interval, identified_text
