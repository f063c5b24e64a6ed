"""A commented sweep file to start from."""

import json

from contactlab.schema.vocabulary import Vocabulary

SCHEMA_NAME = "contactlab-sweep.schema.json"
_FIRST = {"timestep": (5e-4, 1e-3, 2e-3, 4e-3)}
_MOST_LISTED = 40


def starter(scene: str, vocabulary: Vocabulary) -> str:
    """Return a sweep file of a scene, ready to run, with comments on what else it can hold."""
    axes = [f"  {name}: [{', '.join(words)}]" for name, words in _axes(vocabulary).items()]
    expected = "stable" if "stable" in vocabulary.labels else next(iter(vocabulary.labels), "")
    metric = next(iter(vocabulary.metrics), "")
    lines = [
        f"# yaml-language-server: $schema=./{SCHEMA_NAME}",
        "version: 1",
        f"scene: {json.dumps(scene, ensure_ascii=False)}",
        "# duration: 1.0       # s of simulated time; the scene's own if left out",
        "seeds: 1              # a count, or a list such as [0, 7]",
        "",
        "# The sweep is the product of its axes. An axis is a list, or one of",
        "#   {linspace: [first, last, count]}   {logspace: [first, last, count]}",
        "#   {range: [first, last, step]}       {values: [...], role: scenario}",
        "#   {uniform: [low, high]}             {loguniform: [low, high]}   (with `sample`)",
        "# A knob is a setting that you may choose; a scenario is an external condition.",
        "axes:" if axes else "axes: {}",
        *axes,
        "",
        "# zip:                  # axes that advance together",
        "#   - {axis_a: [1, 2], axis_b: [10, 20]}",
        "# sample: {method: sobol, n: 64, seed: 0}",
        "# exclude:              # partial matches or expressions",
        '#   - {where: "timestep > 2e-3"}',
        "# include:              # further rows, or {file: runs.csv}",
        "#   - {timestep: 1e-4}",
        *([f"# tolerances: {{{metric}: 1e-3}}   # what is accurate enough"] if metric else []),
        *(["# expect:               # makes the sweep a test"] if expected else []),
        *([f"#   - {{where: {{timestep: 1e-3}}, label: {expected}}}"] if expected else []),
        "trace: all            # all, flagged, none or sample:N",
        "",
        *_listing(vocabulary),
    ]
    return "\n".join(lines).rstrip() + "\n"


def _axes(vocabulary: Vocabulary) -> dict[str, list[str]]:
    """Return a few common axes, as far as the scene has them."""
    axes: dict[str, list[str]] = {}
    for name in ("timestep", "integrator", "cone"):
        spec = vocabulary.axes.find(name)
        values = (_FIRST.get(name) or spec.choices) if spec else ()
        written = [f"{value:g}" if isinstance(value, float) else str(value) for value in values]
        if spec and written and all(map(spec.accepts, values)):
            axes[name] = written
    return axes


def _listing(vocabulary: Vocabulary) -> list[str]:
    names = list(vocabulary.axes.names)[:_MOST_LISTED]
    specs = [spec for name in names if (spec := vocabulary.axes.find(name))]
    width = max((len(spec.name) for spec in specs), default=0)
    lines = ["# Axes of this scene:"] if specs else []
    for spec in specs:
        takes = f" [{spec.unit}]" if spec.unit else ""
        takes = f": {', '.join(spec.choices)}" if spec.choices else takes
        lines.append(f"#   {spec.name:<{width}}  {spec.description}{takes}")
    return lines
