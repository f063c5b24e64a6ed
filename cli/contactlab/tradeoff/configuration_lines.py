"""A configuration as lines of MJCF, from the record of one of its runs."""

from collections.abc import Collection
from dataclasses import dataclass

from contactlab.mjcf import CONTACT, FLAGS, OPTIONS, attribute_of, default_lines, option_lines
from contactlab.schema import EvidenceRecord, Setting


@dataclass(frozen=True)
class MjcfLines:
    """A configuration as MJCF.

    Attributes:
        mjcf: lines to put below `<mujoco>`; a geom's own attributes go over its defaults.
        other: knobs that are neither options, nor switches, nor defaults of geoms.
    """

    mjcf: tuple[str, ...]
    other: dict[str, Setting]


def mjcf_lines(knobs: Collection[str], record: EvidenceRecord) -> MjcfLines:
    """Return the lines that set some knobs as a run had them.

    Args:
        knobs: names of axes; `solref.timeconst` and the like stand for the whole attribute.
        record: a run of the configuration, for the resolved settings.
    """
    flags = {
        name: value
        for name in knobs
        if name in FLAGS and isinstance(value := record.axes.get(name), bool)
    }
    sets = {name: attribute_of(name) for name in knobs if name not in flags}
    known = {*OPTIONS, *CONTACT}
    texts = {name: _text(name, record.settings[name]) for name in sets.values() if name in known}
    options = {name: text for name, text in texts.items() if name in OPTIONS}
    contact = {name: text for name, text in texts.items() if name in CONTACT}
    return MjcfLines(
        mjcf=(*option_lines(options, flags), *default_lines(contact)),
        other={name: record.axes[name] for name, to in sets.items() if to not in texts},
    )


def _text(name: str, value: Setting) -> str:
    """Return a setting as MJCF has it; of a pair's five friction coefficients, a geom has three."""
    if isinstance(value, tuple):
        pair = name == "friction" and len(value) == 5
        parts = (value[0], value[2], value[3]) if pair else value
        return " ".join(_text("", each) for each in parts)
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)
