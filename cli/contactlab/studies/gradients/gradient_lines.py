"""The gradients report as text."""

from collections.abc import Iterator, Sequence

from contactlab.schema.gradients import Band, GradientInput, GradientsReport

Row = tuple[str, ...]


def headline(report: GradientsReport) -> str:
    """Return the differentiated coordinate and the timesteps."""
    own, finest = (f"{1e3 * step:g} ms" for step in report.steps)
    return (
        f"{report.scene}: derivative of {report.output_coordinate} after {report.duration:g} s, of "
        f"the run at its timestep of {own}, and of the model at timesteps up to {finest}"
    )


def place_rows(report: GradientsReport) -> tuple[Row, list[Row]]:
    """Return the table of one place: one row per input."""
    (place,) = report.places
    methods = list(next(iter(place.inputs.values())).methods)
    header = ("input", "value", "model", "run", *methods)
    rows = [
        (
            name,
            f"{each.value:g}",
            _model_cell(each),
            *(_method_cell(value, each.verdicts[how]) for how, value in _run_values(each).items()),
        )
        for name, each in place.inputs.items()
    ]
    return header, rows


def map_rows(report: GradientsReport) -> tuple[Row, list[Row]]:
    """Return the table of a map: one row per input and method."""
    verdicts = list(report.bands[0].counts)
    header = ("input", "method", *verdicts, *(f"unusable, {axis}" for axis in report.axes))
    return header, [_band_row(band, verdicts, len(report.places)) for band in report.bands]


def advice(report: GradientsReport) -> Iterator[str]:
    """Yield a sentence of advice for each input that needs one."""
    if report.axes:
        yield (
            f"{len({place.mode for place in report.places})} modes, {report.mode_switches} mode "
            "switches between neighbors"
        )
        return
    for name, each in report.places[0].inputs.items():
        verdict, span = each.verdicts["run"], each.model.span
        if verdict == "agrees" or span is None or each.run.value is None:
            continue
        if verdict == "unknown":
            yield f"{name}: the model's derivative over +-{span:g} is uncertain by more than half"
            continue
        yield (f"{name}: the run's derivative {verdict}. Use smoothed differences over +-{span:g}.")


def _run_values(each: GradientInput) -> dict[str, float | None]:
    return {"run": each.run.value, **each.methods}


def _model_cell(each: GradientInput) -> str:
    value, bound = each.model.value, each.model.bound
    return "-" if value is None or bound is None else f"{value:.4g} +- {bound:.1g}"


def _method_cell(value: float | None, verdict: str) -> str:
    return "-" if value is None else f"{value:.4g} {verdict}"


def _band_row(band: Band, verdicts: Sequence[str], places: int) -> Row:
    shares = (f"{100 * band.counts[verdict] / places:.0f} %" for verdict in verdicts)
    return (band.parameter, band.method, *shares, *(f"{x:.3g}" for x in band.widths.values()))
