"""The reports of `contactlab effects` and of `contactlab fit`."""

from collections.abc import Sequence
from statistics import median
from typing import Literal

from contactlab.schema.evidence import Engine, Provenance, Setting
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task

EFFECTS_VERSION = 1

Need = Literal["needed", "free", "not exercised", "unused", "absent", "saves", "idle"]


class Ratio(Model):
    """A ratio of CPU times, from interleaved runs."""

    ratio: float = about("Median over matched pairs of runs.")
    low: float = about("Least of the pairs.")
    high: float = about("Largest of the pairs.")
    pairs: int

    @classmethod
    def of(cls, ratios: Sequence[float]) -> "Ratio":
        """Return the ratio of some pairs."""
        return cls(ratio=median(ratios), low=min(ratios), high=max(ratios), pairs=len(ratios))


class MetricChange(Model):
    """Change of one metric by one effect, in the scenario where it changes most."""

    metric: str
    unit: str
    change: float | None = about(
        "Mean over matched pairs; null where only one of the two can be measured."
    )
    tolerance: float
    times: float | None = about("The change over the tolerance; null likewise.")
    spread: float = about("Range over seeds without the change.")
    scenario: dict[str, Setting]
    matters: bool = about("Whether it is beyond both tolerance and spread.")


class EffectFinding(Model):
    """One effect, changed alone from the base configuration."""

    effect: str
    kind: str
    what: str
    on: bool = about("In the base configuration.")
    need: Need = about(
        "needed: on, and off changes results; free: on, and off changes nothing; "
        "not exercised: on, and nothing that any run does calls for it; "
        "unused: free by proof; absent: off, and on changes results; saves: off, and on takes "
        "less time and changes nothing; idle: off, and on changes nothing."
    )
    reason: str
    settings: dict[str, Setting] = about("The changed settings, as axes of a sweep.")
    changes: tuple[MetricChange, ...] = about("Largest first, in tolerances.")
    within_spread: tuple[str, ...] = about(
        "Metrics beyond tolerance, but within the spread over seeds."
    )
    labels: dict[str, int] = about("Label changes, as `stable -> tunneling`, by runs.")
    cost: Ratio | None = about("CPU time with the change over that without it.")
    work: dict[str, float] = about("Ratios of work counters, change over base.")


class Interaction(Model):
    """Two effects, left out together."""

    effects: tuple[str, str]
    free: bool = about("Whether results stay within tolerance without both.")
    reason: str


class SmallestSet(Model):
    """The fewest effects that keep every result within tolerance."""

    on: tuple[str, ...]
    off: tuple[str, ...] = about("Effects of the base that it leaves out.")
    added: tuple[str, ...] = about("Effects that it adds to the base.")
    settings: dict[str, Setting] = about("Its settings, as axes of a sweep.")
    mjcf: tuple[str, ...] = about("Its changes of the model's files: where, and the element then.")
    unwritten: str | None = about("Why these files cannot have it; null if they can.", default=None)
    sweep: tuple[str, ...] = about("Its lines of a sweep file.")


class Verification(Model):
    """The smallest set against the base configuration, from fresh seeds and scenarios."""

    seeds: tuple[int, ...]
    scenarios: tuple[dict[str, Setting], ...]
    runs: int = about("Matched pairs.")
    pasted: bool | None = about(
        "Whether it holds as written into the model's files; null without.", default=None
    )
    holds: bool
    reason: str
    cost: Ratio | None


class EffectsReport(Model):
    """Every effect of one scene (`effects.json`). Units are SI; each change names its own."""

    effects_version: Literal[1] = EFFECTS_VERSION
    scene: str
    scene_hash: str
    source: str = about("The scene, sweep or model as given.")
    task: Task = about("What it is judged on.")
    base: dict[str, Setting] = about("Axes of the base configuration.")
    scenarios: tuple[dict[str, Setting], ...]
    seeds: tuple[int, ...]
    duration: float = about("s")
    tolerances: dict[str, float] = about(
        "Those of the sweep or scene; if any, only they and labels decide."
    )
    engine: Engine
    provenance: Provenance
    effects: tuple[EffectFinding, ...]
    interactions: tuple[Interaction, ...]
    smallest_set: SmallestSet
    saving: Ratio | None = about("CPU time of the smallest set over the base's.")
    verification: Verification
    stores: tuple[str, ...] = about("The evidence, relative to the report.")


FIT_REPORT, FITTED = "fit.json", "fitted.xml"


class FittedSetting(Model):
    """One setting that was free."""

    name: str
    value: Setting
    interval: tuple[float, float] | None = about(
        "95 % over resampled runs, and all values that are as good; null for a word."
    )
    profile: dict[str, float] = about("Mean error by its value, the others as fitted.")
    identified: bool = about("Whether the recordings tell its value: else the profile is flat.")


class FitReport(Model):
    """Result of a fit; errors are means over recorded runs."""

    schema_version: Literal[1] = 1
    scene: str
    scene_hash: str
    error: str = about("The metric that was made small.")
    settings: tuple[FittedSetting, ...]
    fitted_runs: tuple[float, ...]
    fitted_error: float
    held_out: dict[str, float] = about("Error of each run that no setting was fitted to.")
    held_out_error: float
    held_out_interval: tuple[float, float] = about("95 %, over resampled runs.")
    written_error: float = about("Of the model as written, over the runs held out.")
    noise_floor: float | None = about(
        "By how much the start noise that the scene declares, its `perturb`, moves the error of a "
        "run, on average; null if it declares none.",
        default=None,
    )
    lines: tuple[str, ...] = about("What changes in the files of the model.")
    runs: int = about("Simulated in all.")
