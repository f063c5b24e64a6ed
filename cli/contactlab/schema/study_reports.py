"""The reports of `contactlab effects` and of `contactlab fit`."""

from typing import Literal

from contactlab.schema.evidence import Engine, Provenance, Setting
from contactlab.schema.report_model import ReportModel
from contactlab.schema.strict_model import Model, about
from contactlab.schema.task import Task
from contactlab.schema.time_ratio import TimeRatio
from contactlab.schema.verification import VerifiedChange

EFFECTS_VERSION = 2

EffectVerdict = Literal[
    "needed", "below the tolerance", "not exercised", "unused", "missing", "saves time", "no effect"
]


class MetricChange(Model):
    """Change of one metric by one effect, in the scenario where it changes most."""

    metric: str
    unit: str
    change: float | None = about(
        "Mean over matched pairs; null if only one of the two can be measured."
    )
    tolerance: float
    ratio_to_tolerance: float | None = about("The change over the tolerance; null likewise.")
    spread: float = about("Range over seeds without the change.")
    scenario: dict[str, Setting]
    significant: bool = about("Whether it is larger than both tolerance and spread.")


class EffectFinding(Model):
    """One effect, changed alone from the base configuration."""

    effect: str
    kind: str
    summary: str
    on: bool = about("In the base configuration.")
    verdict: EffectVerdict = about(
        "needed: on, and turning it off changes results; below the tolerance: on, and turning it "
        "off changes nothing; not exercised: on, and no run uses it; unused: on, and turning it "
        "off changes nothing by proof; missing: off, and turning it on changes results; saves "
        "time: off, and turning it on takes less time and changes nothing; no effect: off, and "
        "turning it on changes nothing."
    )
    reason: str
    settings: dict[str, Setting] = about("The changed settings, as axes of a sweep.")
    metric_changes: tuple[MetricChange, ...] = about("Largest first, in tolerances.")
    within_spread: tuple[str, ...] = about(
        "Metrics above the tolerance, but within the spread over seeds."
    )
    labels: dict[str, int] = about("Label changes, as `stable -> tunneling`, by runs.")
    time_ratio: TimeRatio | None = about("CPU time with the change over that without it.")
    work_ratios: dict[str, float] = about("Ratios of work counters, change over base.")


class Interaction(Model):
    """Two effects that are changed together."""

    effects: tuple[str, str]
    below_tolerance: bool = about("Whether results stay within the tolerance without both.")
    reason: str


class SmallestSet(Model):
    """The fewest effects that keep every result within the tolerance."""

    on: tuple[str, ...]
    off: tuple[str, ...] = about("Effects of the base that it turns off.")
    added: tuple[str, ...] = about("Effects that it adds to the base.")
    kept: dict[str, str] = about(
        "Effects that stay, since another load needs them, with the measure that was worse.",
        default={},
    )
    settings: dict[str, Setting] = about("Its settings, as axes of a sweep.")
    mjcf: tuple[str, ...] = about("Its changes of the model files: the line, and its new element.")
    no_patch_reason: str | None = about(
        "Why the model files cannot have it; null if they can.", default=None
    )
    sweep: tuple[str, ...] = about("Its lines of a sweep file.")


class Verification(Model):
    """The smallest set against the base configuration, with fresh seeds and scenarios."""

    seeds: tuple[int, ...]
    scenarios: tuple[dict[str, Setting], ...]
    runs: int = about("Matched pairs.")
    holds_as_written: bool | None = about(
        "Whether it also holds as written into the model files; null if not written.", default=None
    )
    holds: bool
    reason: str
    time_ratio: TimeRatio | None
    measures: VerifiedChange | None = about(
        "Measures of the written model against those of the base; null if not written.",
        default=None,
    )


class RecordedEffectsReport(ReportModel):
    """Every effect of one scene (`effects.json`). Units are SI; each change states its own."""

    effects_version: Literal[2] = EFFECTS_VERSION
    scene: str
    scene_hash: str
    source: str = about("The scene, sweep or model as given.")
    task: Task = about("The task that it is judged on.")
    base: dict[str, Setting] = about("Axes of the base configuration.")
    scenarios: tuple[dict[str, Setting], ...]
    seeds: tuple[int, ...]
    duration: float = about("s")
    tolerances: dict[str, float] = about(
        "Tolerances of the sweep or scene; if there are any, only they and labels decide."
    )
    engine: Engine
    provenance: Provenance
    effects: tuple[EffectFinding, ...]
    interactions: tuple[Interaction, ...]
    smallest_set: SmallestSet
    time_ratio: TimeRatio | None = about("CPU time of the smallest set over the base's.")
    verification: Verification
    stores: tuple[str, ...] = about("The evidence, relative to the report.")

    @property
    def problem(self) -> str:
        """Why the smallest set fails with fresh seeds, if it does."""
        verified = self.verification
        return (
            "" if verified.holds else f"the smallest set fails with fresh seeds: {verified.reason}"
        )


FIT_REPORT, FITTED = "fit.json", "fitted.xml"


class FittedSetting(Model):
    """One fitted setting."""

    name: str
    value: Setting
    interval: tuple[float, float] | None = about(
        "95 % over resampled runs, with all values that are as good; null for a word."
    )
    profile: dict[str, float] = about("Mean error by its value, with the other settings as fitted.")
    identified: bool = about(
        "Whether the recordings determine its value; else the profile is flat."
    )


class FitReport(ReportModel):
    """Result of a fit; errors are means over recorded runs."""

    schema_version: Literal[2] = 2
    scene: str
    scene_hash: str
    metric: str = about("The metric that was minimized.")
    settings: tuple[FittedSetting, ...]
    fitted_runs: tuple[float, ...]
    fitted_error: float
    held_out: dict[str, float] = about("Error of each held-out run.")
    held_out_error: float
    held_out_interval: tuple[float, float] = about("95 %, over resampled runs.")
    current_error: float = about("Error of the model as written, over the held-out runs.")
    noise_floor: float | None = about(
        "Mean change of the error of a run by the start noise of the scene, its `perturb`; null if "
        "the scene declares none.",
        default=None,
    )
    lines: tuple[str, ...] = about("Changed lines of the model files.")
    runs: int = about("Number of simulated runs.")
