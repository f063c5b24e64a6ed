"""A commented sweep file to start from: the scene unchanged, and a few values near its own."""

import json
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence

from contactlab.mjcf import is_condition
from contactlab.printable import shell_word
from contactlab.schema.task import SEEDS
from contactlab.schema.vocabulary import DROP_HEIGHT, Vocabulary

SCHEMA_NAME = "contactlab-sweep.schema.json"
_SEED_COUNT = len(SEEDS)
_ERROR_METRIC = "backward_error"
_FREE = re.compile(r"\.v?[xyz]$")
_PLAIN_WORD = re.compile(r"[A-Za-z][\w.-]*")


Settings = Mapping[str, object]
"""The settings that all geoms and options of a scene share, by name."""


def starter_text(
    reference: str, settings: Settings, duration: float, drive: str | None, vocabulary: Vocabulary
) -> str:
    """Return a sweep file of a scene, ready to run, with comments on its other possible content.

    The first value of each axis is the scene's own. The duration [s] is that of simulated time.
    Leave out a drive that the scene has itself. The reference is relative to the file.
    """
    axes = [
        _axis_line(name, values, vocabulary) for name, values in _common_axes(settings, vocabulary)
    ]
    further = [
        _axis_line(
            name,
            (own, *_other_choices(name, own, vocabulary), *([10.0] * (own == 1.0))),
            vocabulary,
        )
        for name, own in _scene_settings(
            settings, vocabulary, ("keyframe", "solver", "solimp", "impratio")
        )
    ]
    can_drop = DROP_HEIGHT in vocabulary.axes and vocabulary.find(DROP_HEIGHT) is not None
    expected = "stable" if "stable" in vocabulary.labels else next(iter(vocabulary.labels), "")
    driven = f"drive: {drive}" if drive else "# drive: none"
    timestep = _yaml_value(settings.get("timestep", 1e-3))
    tolerances = [
        "# The cheapest settings within these are recommended. The first bounds the",
        "# numerical error of the motion: residual forces over real ones, measured in every run.",
        f"tolerances: {{{_ERROR_METRIC}: 10%}}",
        "checks: all           # or flagged: of runs that are not stable alone",
    ]
    lines = [
        f"# yaml-language-server: $schema=./{SCHEMA_NAME}",
        "version: 1",
        f"scene: {json.dumps(reference, ensure_ascii=False)}",
        f"duration: {_yaml_value(duration):<12}# s of simulated time",
        f"{driven:<22}# auto: the controls of the keyframe, else exercise; none; hold;",
        f"{'':<22}# {{noise: 0.3, rate: 10}}, {{file: controls.csv}} or {{policy: FILE.py:CLASS}}",
        f"seeds: {_SEED_COUNT:<15}# a count, or a list such as [0, 7]",
        "",
        "# The sweep is the product of its axes; of each, the first value is the scene's own.",
        "# An axis is a list, or one of",
        "#   {linspace: [first, last, count]}   {logspace: [first, last, count]}",
        "#   {range: [first, last, step]}       {values: [...], role: scenario}",
        "#   {uniform: [low, high]}             {loguniform: [low, high]}   (with `sample`)",
        "# A knob is a setting that you may choose; a scenario is an external condition.",
        "axes:" if axes else "axes: {}",
        *(f"  {line}" for line in axes),
        *(
            ["  # drop_height: [0, 0.1]   # m, of all free bodies above the start"]
            if can_drop
            else []
        ),
        *(f"  # {line}" for line in further),
        "",
        "# zip:                  # axes that advance together",
        "#   - {axis_a: [1, 2], axis_b: [10, 20]}",
        "# sample: {method: sobol, n: 64, seed: 0}",
        "# exclude:              # partial matches or expressions",
        f'#   - {{where: "timestep > {timestep}"}}',
        "# include:              # further rows, or {file: runs.csv}",
        "#   - {timestep: 1e-4}",
        *(tolerances if _ERROR_METRIC in vocabulary.metrics else []),
        *(["# expect:               # makes the sweep a test"] if expected else []),
        *([f"#   - {{where: {{timestep: {timestep}}}, label: {expected}}}"] if expected else []),
        "trace: all            # all, flagged, none or sample:N; without one, a run has no film",
        "trace_format: messages # which viewers open; compact is smaller, for contactlab alone",
        "",
        *_axis_list(reference, vocabulary),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _common_axes(
    settings: Settings, vocabulary: Vocabulary
) -> Iterator[tuple[str, Sequence[object]]]:
    """Yield a few common axes with their values, as far as the scene has them.

    No value depends on refsafe, which raises a time constant of solref to two timesteps.
    """
    timestep, solref = settings.get("timestep"), settings.get("solref")
    constant = float(solref[0]) if isinstance(solref, tuple) else 0.0
    periods = constant / timestep if isinstance(timestep, float) else 0.0
    # If a time constant of solref has fewer timesteps, no longer timesteps are proposed.
    few_steps = 4
    for name, own in _scene_settings(
        settings, vocabulary, ("timestep", "integrator", "cone", "solref")
    ):
        others: Sequence[object] = ()
        if isinstance(own, float):
            others = own / 2, own / 4 if 0 < periods < few_steps else own * 2
        elif isinstance(own, tuple) and constant > 0:
            others = ((constant / 2 if periods >= 2 * few_steps else constant * 2, own[1]),)
        elif isinstance(own, str):
            words = _other_choices(name, own, vocabulary)
            others = [word for word in words if word == "implicitfast"] or words[:1]
        yield name, (own, *others)


def _scene_settings(
    settings: Settings, vocabulary: Vocabulary, names: Sequence[str]
) -> Iterator[tuple[str, object]]:
    for name in names:
        spec = vocabulary.find(name)
        if spec and name in settings and spec.accepts_value(settings[name]):
            yield name, settings[name]


def _other_choices(name: str, own: object, vocabulary: Vocabulary) -> Sequence[str]:
    spec = vocabulary.find(name)
    return [word for word in (spec.choices if spec else ()) if word != own]


def _axis_line(name: str, values: Sequence[object], vocabulary: Vocabulary) -> str:
    line = f"{name}: [{', '.join(map(_yaml_value, values))}]"
    other_words = [
        word for word in _other_choices(name, values[0], vocabulary) if word not in values
    ]
    return f"{line}   # also {', '.join(other_words)}" if other_words else line


def _yaml_value(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_yaml_value(part) for part in value)}]"
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    text = str(value)
    return text if _PLAIN_WORD.fullmatch(text) else json.dumps(text)


def _axis_list(reference: str, vocabulary: Vocabulary) -> list[str]:
    most_names = 40
    # Conditions first: a reader knows the settings of MuJoCo, and seldom that the start is an axis.
    names = sorted(vocabulary.axes, key=lambda name: not is_condition(name))
    specs = [spec for name in names[:most_names] if (spec := vocabulary.find(name))]
    width = max((len(spec.name) for spec in specs), default=0)
    lines = ["# Axes of this scene:"] if specs else []
    line_width = 100  # of the list of axes
    for spec in specs:
        takes = f" [{spec.unit}]" if spec.unit else ""
        takes = f": {', '.join(spec.choices)}" if spec.choices else takes
        begin = f"#   {spec.name:<{width}}  "
        lines += textwrap.wrap(
            f"{begin}{spec.description}{takes}",
            line_width,
            subsequent_indent="#" + " " * (len(begin) - 1),
            break_on_hyphens=False,
        )
    if vocabulary.coordinates:
        # Free bodies first, which drop heights and speeds are of.
        some = sorted(vocabulary.coordinates, key=lambda name: not _FREE.search(name))[:6]
        lines.append("#   and each coordinate or velocity of a joint at the start:")
        lines.append(f"#   {', '.join(some)}, ...")
    if len(names) > most_names:
        command = f"contactlab list axes {shell_word(reference)}"
        lines.append(f"#   and {len(names) - most_names} more: {command}")
    return lines
