"""The lines of MJCF that make a change."""

from collections.abc import Mapping

from contactlab.run.record import as_written
from contactlab.scene import PARAMETERS
from contactlab.schema import Change
from contactlab.studies.check.bench import Values
from contactlab.studies.check.target import Target

_CONTACT = ("solref", "solimp", "friction", "condim", "margin", "gap")
_USUAL_CURVE = (0.5, 2.0)


def change(target: Target, settings: Values, *, cures: bool | None, shown: str) -> Change:
    """Return a change of settings, with the lines that make it in the target's model."""
    return Change(
        lines=mjcf(settings, explicit=bool(target.base.targets.explicit)),
        settings={name: as_written(value) for name, value in settings.items()},
        cures=cures,
        shown=shown,
    )


def mjcf(settings: Values, *, explicit: bool = False) -> tuple[str, ...]:
    """Return the lines that set options and contact parameters.

    Args:
        settings: values by axis.
        explicit: whether <pair> elements hold contact parameters as well.
    """
    contact = {name: settings[name] for name in _CONTACT if name in settings}
    option = {name: settings[name] for name in settings if name in PARAMETERS.keys() - {*_CONTACT}}
    lines = [f"<option{_attributes(option)}/>"] if option else []
    if contact:
        lines += ["<default>", f"  <geom{_attributes(contact)}/>"]
        lines += [f"  <pair{_attributes(contact)}/>"] if explicit else []
        lines += ["</default>"]
    return tuple(lines)


def _attributes(values: Mapping[str, object]) -> str:
    return "".join(f' {name}="{written(value)}"' for name, value in values.items())


def written(value: object) -> str:
    """Return a value as MJCF has it; an impedance without the curve that it has by default."""
    if isinstance(value, tuple) and value[3:] == _USUAL_CURVE:
        value = value[:3]
    if isinstance(value, float):
        value = (value,)
    return str(as_written(value))
