"""The report on a terminal."""

from collections.abc import Iterator, Sequence

from contactlab.schema.gradients import Band, GradientBy, GradientsReport

Row = tuple[str, ...]


def head(report: GradientsReport) -> str:
    """Return what was differentiated, of what."""
    own, finest = (f"{1e3 * step:g} ms" for step in report.steps)
    return (
        f"{report.scene}: derivative of {report.of} after {report.duration:g} s; of the run at its "
        f"step of {own}, and of the model by steps of {finest} and less"
    )


def place_rows(report: GradientsReport) -> tuple[Row, list[Row]]:
    """Return the table of one place: a row a parameter."""
    (place,) = report.places
    means = list(next(iter(place.by.values())).told)
    header = ("by", "at", "of the model", "of the run", *means)
    rows = [
        (
            name,
            f"{by.at:g}",
            _with_bound(by),
            *(_told(value, by.words[how]) for how, value in _values(by).items()),
        )
        for name, by in place.by.items()
    ]
    return header, rows


def map_rows(report: GradientsReport) -> tuple[Row, list[Row]]:
    """Return the table of a map: a row a parameter and means."""
    words = list(report.bands[0].counts)
    header = ("by", "of", *words, *(f"unusable, {axis}" for axis in report.axes))
    return header, [_band_row(band, words, len(report.places)) for band in report.bands]


def advice(report: GradientsReport) -> Iterator[str]:
    """Yield what to do, a sentence a parameter that needs one."""
    if report.axes:
        yield (
            f"{len({place.mode for place in report.places})} modes, {report.switches} switches "
            "between neighbours"
        )
        return
    for name, by in report.places[0].by.items():
        word, span = by.words["run"], by.model.span
        if word == "agrees" or span is None or by.run.value is None:
            continue
        if word == "unknown":
            yield f"{name}: over {span:g} either way no derivative is known to half of itself"
            continue
        yield (
            f"{name}: the run's derivative {word}; use differences over {span:g} either way, "
            "smoothed"
        )


def _values(by: GradientBy) -> dict[str, float | None]:
    return {"run": by.run.value, **by.told}


def _with_bound(by: GradientBy) -> str:
    value, bound = by.model.value, by.model.bound
    return "-" if value is None or bound is None else f"{value:.4g} +- {bound:.1g}"


def _told(value: float | None, word: str) -> str:
    return "-" if value is None else f"{value:.4g} {word}"


def _band_row(band: Band, words: Sequence[str], places: int) -> Row:
    shares = (f"{100 * band.counts[word] / places:.0f} %" for word in words)
    return (band.parameter, band.means, *shares, *(f"{x:.3g}" for x in band.widths.values()))
