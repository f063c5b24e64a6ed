"""Draw a report: what each effect changes, and what it costs; the libraries are an extra."""

from importlib.util import find_spec
from pathlib import Path

from contactlab.errors import OutputError
from contactlab.schema import EffectsReport

SUFFIXES = (".png", ".svg")
_LIBRARIES = ("altair", "vl_convert")
_SCALE = 2.0


def check_figure(path: Path) -> None:
    """Check that a figure can be drawn, before anything is run for it.

    Raises:
        OutputError: the suffix is not known, the libraries or the folder are missing.
    """
    if path.suffix not in SUFFIXES:
        raise OutputError(f"{path}: write a name that ends in {' or '.join(SUFFIXES)}")
    if not all(find_spec(library) for library in _LIBRARIES):
        raise OutputError(
            "figures need Altair and vl-convert; install them with "
            "`pip install 'contactlab[figures]'`"
        )
    if not path.parent.is_dir():
        raise OutputError(f"cannot write {path}: no folder {path.parent}")


def draw(report: EffectsReport, path: Path) -> None:
    """Draw a report as two columns of bars, one row an effect.

    Args:
        report: what to draw.
        path: a .png or .svg file.

    Raises:
        OutputError: as `check_figure`, or it cannot be written.
    """
    check_figure(path)
    from contactlab.pipeline.effects.bars import specification  # noqa: PLC0415 - needs the extra

    try:
        specification(report).save(path, scale_factor=_SCALE)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error
