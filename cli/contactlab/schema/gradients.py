"""The report of `contactlab gradients`: where a derivative through contact can be trusted."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import FiniteOrNull, Model, about

GradientVerdict = Literal["agrees", "differs", "vanishes", "explodes", "unknown"]
GRADIENT_VERDICTS: dict[GradientVerdict, str] = {
    "agrees": "within the tolerance of the model's derivative",
    "differs": "beyond the tolerance of the model's derivative",
    "vanishes": "less than a hundredth of the model's derivative",
    "explodes": "more than ten times the model's derivative",
    "unknown": "the model's derivative is uncertain by more than half: a mode switch is near, or "
    "steps scatter",
}

REPORT = "gradients.json"
"""Name of its file."""


class Difference(Model):
    """A derivative by finite differences."""

    value: FiniteOrNull = about("Null if no run gave one.")
    bound: FiniteOrNull = about("Bound on its error; null if there is none.")
    span: FiniteOrNull = about("Half-width of the wider of the two differences behind it.")


class LadderRung(Model):
    """A plain central difference."""

    step: float = about("Timestep of the runs.", unit="s")
    span: float = about("Half-width, in the parameter's unit.")
    value: FiniteOrNull = about("Null if a run failed.")


class GradientInput(Model):
    """The derivative of the output coordinate with respect to one input, at one place."""

    value: float = about("Value of the input, in its own unit.")
    model: Difference = about("Derivative of the model: over many steps, at the finest step.")
    run: Difference = about("Derivative of the run at its own step: spans of less than a step.")
    methods: dict[str, FiniteOrNull] = about(
        "Derivative of the run by other methods: `chain`, MuJoCo's mjd_transitionFD step by step; "
        "`mjx`, automatic differentiation; `mjx-adaptive`, the same by substeps. Null if a method "
        "gives none."
    )
    verdicts: dict[str, GradientVerdict] = about(
        "Verdicts on `run` and the other methods, compared with the model's derivative."
    )
    ladder: tuple[LadderRung, ...] = about("Every difference; empty on a map.")


class GradientPlace(Model):
    """One place: a setting of the scene."""

    settings: dict[str, Setting]
    end: FiniteOrNull = about("Value of the output coordinate; null if the run failed.")
    mode: str = about("Modes of the pairs, in order: apart, stick, slide.")
    inputs: dict[str, GradientInput] = about("By input.")


class Band(Model):
    """Places of a map without a usable derivative."""

    parameter: str
    method: str = about("`run`, or another method.")
    counts: dict[str, int] = about("Places by verdict.")
    share: float = about("Share of places where it does not agree.", unit="1")
    widths: dict[str, float] = about(
        "By axis, in its unit: mean length of disagreement along that axis."
    )


class GradientsReport(ReportModel):
    """Trust in derivatives of a scene's end state, place by place."""

    gradients_version: Literal[2] = 2
    source: str = about("The scene or sweep, as given.")
    scene: str
    scene_hash: str
    mujoco: str = about("Version of MuJoCo.")
    engines: dict[str, str] = about("Versions of the other engines.")
    output_coordinate: str = about("The differentiated coordinate, at the end of a run.")
    duration: float = about("Duration of a run.", unit="s")
    steps: tuple[float, ...] = about("Timesteps: the scene's own, and the finest.", unit="s")
    tolerance: float = about("Largest missing share of the model's derivative.", unit="1")
    axes: dict[str, tuple[float, ...]] = about(
        "Axes of the map, the slowest first; empty for one place."
    )
    places: tuple[GradientPlace, ...] = about("In the order of the axes.")
    bands: tuple[Band, ...] = about("Empty for one place.")
    mode_switches: int = about("Neighbors on the map with different modes.")
    notes: tuple[str, ...] = ()
