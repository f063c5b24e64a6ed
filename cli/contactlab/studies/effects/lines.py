"""The lines of MJCF and of a sweep file that make a set of effects."""

from collections.abc import Iterable, Mapping

from contactlab.run.record import as_written
from contactlab.scene import FLAGS
from contactlab.studies.effects.question import Values

_OPTIONS = {
    "elliptic": ("cone", {True: "elliptic", False: "pyramidal"}),
    "noslip": ("noslip_iterations", {True: "3", False: "0"}),
    "implicit": ("integrator", {True: "implicitfast", False: "Euler"}),
}
_AIR = {"density": "0", "viscosity": "0", "wind": "0 0 0"}
_DIMS = {
    "tangential_friction": {True: 3, False: 1},
    "torsional_friction": {True: 4, False: 3},
    "rolling_friction": {True: 6, False: 4},
}
_REMARKS = {
    "sensor": "<!-- remove the elements of <sensor> -->",
    "tendon": "<!-- in <tendon>, set no stiffness, damping, friction loss, armature or range; "
    "remove what no actuator, equality or sensor refers to -->",
}


def mjcf_lines(settings: Values) -> tuple[str, ...]:
    """Return what makes these settings in a model."""
    options = dict(_options(settings))
    flags = {
        name: "enable" if value else "disable"
        for name, value in settings.items()
        if name in FLAGS and isinstance(value, bool)
    }
    return (*_option_lines(options, flags), *_geom_lines(settings), *_remarks(settings))


def sweep_lines(settings: Values, proven: Iterable[str]) -> tuple[str, ...]:
    """Return what makes these settings in a sweep file.

    Args:
        settings: by axis.
        proven: effects that `auto` leaves out by itself.
    """
    switched = {
        name: value
        for name, value in settings.items()
        if isinstance(value, bool) and name not in set(proven)
    }
    axes = {name: value for name, value in settings.items() if not isinstance(value, bool)}
    words = ["base: auto", *(f"{name}: {str(value).lower()}" for name, value in switched.items())]
    lines = [f"effects: {{{', '.join(words)}}}"]
    if axes:
        lines.append("axes:")
        lines += [f"  {name}: [{as_written(value)}]" for name, value in axes.items()]
    return tuple(lines)


def _options(settings: Values) -> Iterable[tuple[str, str]]:
    for name, value in settings.items():
        if name in _OPTIONS and isinstance(value, bool):
            option, words = _OPTIONS[name]
            yield option, words[value]
        elif name == "air" and value is False:
            yield from _AIR.items()
        elif name == "gravity":
            yield name, "0 0 0"
        elif name == "impratio":
            yield name, str(as_written(value))


def _option_lines(options: Mapping[str, str], flags: Mapping[str, str]) -> list[str]:
    if not flags:
        return [f"<option{_attributes(options)}/>"] if options else []
    head = f"<option{_attributes(options)}>"
    return [head, f"  <flag{_attributes(flags)}/>", "</option>"]


def _geom_lines(settings: Values) -> list[str]:
    bounds = [
        _DIMS[name][value]
        for name, value in settings.items()
        if name in _DIMS and isinstance(value, bool)
    ]
    if not bounds:
        return []
    remark = "<!-- and on every geom and pair that has a condim of its own -->"
    return ["<default>", f'  <geom condim="{min(bounds)}"/> {remark}', "</default>"]


def _remarks(settings: Values) -> list[str]:
    return [text for name, text in _REMARKS.items() if settings.get(name) is False]


def _attributes(values: Mapping[str, str]) -> str:
    return "".join(f' {name}="{value}"' for name, value in values.items())
