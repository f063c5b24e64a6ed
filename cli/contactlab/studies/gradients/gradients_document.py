"""Describes where derivatives through contact can be trusted."""

from collections.abc import Iterator
from pathlib import Path

from contactlab.rendering.amounts import format_amount, format_percent
from contactlab.rendering.document import (
    Block,
    Document,
    Headline,
    Sentence,
    document_of,
    table_of,
)
from contactlab.schema.gradients import REPORT, GradientInput, GradientsReport


def describe_gradients(report: GradientsReport, *, folder: Path | None = None) -> Document:
    """Describe derivatives at one place, or on a map.

    Args:
        report: the derivatives.
        folder: of the report and the evidence, if they were written.
    """
    own, finest = (f"{1e3 * step:g} ms" for step in report.steps)
    headline = (
        f"{report.scene}: derivative of {report.output_coordinate} after {report.duration:g} s, of "
        f"the run at its timestep of {own}, and of the model at timesteps up to {finest}"
    )
    blocks = [Headline(headline), *(_map_blocks(report) if report.axes else _place_blocks(report))]
    blocks += map(Sentence, report.notes)
    if folder is not None:
        blocks.append(Sentence(f"evidence and {REPORT} in {folder}"))
    return document_of(blocks)


def _place_blocks(report: GradientsReport) -> Iterator[Block]:
    """Yield one row per input of one place, then advice for each input that needs one."""
    (place,) = report.places
    methods = list(next(iter(place.inputs.values())).methods)
    rows = [
        (
            name,
            f"{each.value:g}",
            _model_cell(each),
            *(
                "-" if value is None else f"{value:.4g} {each.verdicts[how]}"
                for how, value in {"run": each.run.value, **each.methods}.items()
            ),
        )
        for name, each in place.inputs.items()
    ]
    yield Sentence(place.mode)
    yield table_of(("input", "value", "model", "run", *methods), rows)
    for name, each in place.inputs.items():
        verdict, span = each.verdicts["run"], each.model.span
        if verdict == "agrees" or span is None or each.run.value is None:
            continue
        yield Sentence(
            f"{name}: the model's derivative over +-{span:g} is uncertain by more than half"
            if verdict == "unknown"
            else f"{name}: the run's derivative {verdict}. Use smoothed differences over "
            f"+-{span:g}."
        )


def _map_blocks(report: GradientsReport) -> Iterator[Block]:
    """Yield one row per input and method of a map, then its mode switches."""
    verdicts = list(report.bands[0].counts)
    rows = [
        (
            band.parameter,
            band.method,
            *(format_percent(band.counts[verdict] / len(report.places)) for verdict in verdicts),
            *map(format_amount, band.widths.values()),
        )
        for band in report.bands
    ]
    header = ("input", "method", *verdicts, *(f"unusable, {axis}" for axis in report.axes))
    yield table_of(header, rows)
    yield Sentence(
        f"{len({place.mode for place in report.places})} modes, {report.mode_switches} mode "
        "switches between neighbors"
    )


def _model_cell(each: GradientInput) -> str:
    value, bound = each.model.value, each.model.bound
    return "-" if value is None or bound is None else f"{value:.4g} +- {bound:.1g}"
