"""The report of `contactlab gradients`: where a derivative through contact can be trusted."""

from typing import Literal

from contactlab.schema.evidence import Setting
from contactlab.schema.strict_model import Model, about

GradientWord = Literal["agrees", "differs", "vanishes", "explodes", "unknown"]
GRADIENT_WORDS: dict[GradientWord, str] = {
    "agrees": "within the tolerance of the model's",
    "differs": "beyond the tolerance of the model's",
    "vanishes": "less than a hundredth of the model's",
    "explodes": "more than ten times the model's",
    "unknown": "the model's is not known to half of itself: a switch is near, or steps scatter",
}


class Difference(Model):
    """A derivative by finite differences."""

    value: float | None = about("Null if no run gave one.")
    bound: float | None = about("On its error; null if there is none.")
    span: float | None = about("Of the wider of the two differences that gave it, either way.")


class LadderRung(Model):
    """A plain central difference."""

    step: float = about("Timestep of the runs.", unit="s")
    span: float = about("Either way, in the parameter's unit.")
    value: float | None = about("Null if a run failed.")


class GradientBy(Model):
    """The derivative of the end with respect to one parameter, at one place."""

    at: float = about("The parameter, in its own unit.")
    model: Difference = about("Of the model: spans of many steps, at the finest step.")
    run: Difference = about("Of the run at its own step: spans of less than a step.")
    told: dict[str, float | None] = about(
        "Of the run by other means: `chain`, MuJoCo's mjd_transitionFD step by step; `mjx`, "
        "automatic differentiation, `mjx-adaptive` by substeps. Null where it has none."
    )
    words: dict[str, GradientWord] = about("What `run` and the others are beside the model's.")
    ladder: tuple[LadderRung, ...] = about("Every difference; empty on a map.")


class GradientPlace(Model):
    """One place: a setting of the scene."""

    settings: dict[str, Setting]
    end: float | None = about("What is differentiated; null if the run failed.")
    mode: str = about("What the pairs do one after the other: apart, stick, slide.")
    by: dict[str, GradientBy] = about("By parameter.")


class Band(Model):
    """Places of a map at which a derivative cannot be used."""

    parameter: str
    means: str = about("`run`, or another means.")
    counts: dict[str, int] = about("Places by word.")
    share: float = about("Of places at which it does not agree.", unit="1")
    widths: dict[str, float] = about(
        "By axis, in its unit: mean over the lines along it, of the stretch that does not agree."
    )


class GradientsReport(Model):
    """Where derivatives of a scene's end state can be trusted."""

    source: str = about("The scene or sweep, as it was named.")
    scene: str
    scene_hash: str
    mujoco: str = about("Version of MuJoCo.")
    engines: dict[str, str] = about("Versions of the others that were asked.")
    of: str = about("The coordinate whose end is differentiated.")
    duration: float = about("Of a run.", unit="s")
    steps: tuple[float, ...] = about("Timesteps: the scene's own, and halved.", unit="s")
    tolerance: float = about("Share of the model's derivative that may be missing.", unit="1")
    axes: dict[str, tuple[float, ...]] = about("Of the map, the slowest first; none for one place.")
    places: tuple[GradientPlace, ...] = about("In the order of the axes.")
    bands: tuple[Band, ...] = about("Empty for one place.")
    switches: int = about("Neighbours on the map of different modes.")
    notes: tuple[str, ...] = ()
