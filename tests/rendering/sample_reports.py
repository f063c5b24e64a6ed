"""Small reports of all kinds, to be rendered."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from contactlab.schema.check_report import StabilityReport, StabilityResult
from contactlab.schema.effects_report import EffectsReport, PartEffect
from contactlab.schema.engine_panel import EnginePanel, PanelRun, PanelTask
from contactlab.schema.explanation import Explanation, WordMeaning
from contactlab.schema.gradients import (
    Band,
    Difference,
    GradientInput,
    GradientPlace,
    GradientsReport,
)
from contactlab.schema.grip import (
    GripCause,
    GripControl,
    GripDrift,
    GripFinger,
    GripFix,
    GripPlacement,
    GripPull,
    GripReport,
    GripTrial,
)
from contactlab.schema.report_model import DescribedReport
from contactlab.schema.shrink_report import ShrinkReport
from contactlab.schema.store_reports import (
    Bisection,
    ExpandedTraces,
    PlannedAxis,
    RunReplay,
    StoreVerification,
    SweepForecast,
    WrittenBundle,
)
from contactlab.schema.study_reports import FitReport, FittedSetting
from contactlab.schema.task import Phase, Task
from contactlab.schema.time_ratio import TimeRatio

HASH = "0" * 16


def task() -> Task:
    phases = (Phase(name="held", begin=0.0, end=1.5), Phase(name="excitation", begin=1.5, end=4.0))
    return Task(start="home", drive="exercise", own_controls=True, duration=4.0, phases=phases)


def grip() -> GripReport:
    return GripReport(
        model="hand.xml", mujoco="4.0.0", keyframe=None, verdict="creeps",
        sentence="creeps: box moves at 0.43 mm/s down, steady", tolerance=1e-4, object="box",
        base="palm", opening=0.08,
        controls=(GripControl(name="close", open_control=0, closed_control=1, force=-7, limit=9),),
        fingers=(GripFinger(body="left", force=3.5), GripFinger(body="right", force=3.25)),
        depth=2e-4, depth_share=0.013, weight=0.98,
        drifts=(
            GripDrift(name="down", seconds=2, speeds=(1e-3, float("nan")), trend="steady",
                      speed=4.3e-4, lost_after=float("inf")),
            GripDrift(name="up", seconds=2, speeds=(1e-3,), trend="lost", speed=float("inf"),
                      lost_after=0.75),
        ),
        shake=GripTrial(distance=1e-3, lost=False),
        turn=GripTrial(distance=float("inf"), lost=True),
        pull=GripPull(direction="sideways", force=12.5, weights=12.75),
        placements=(GripPlacement(name="a tenth larger", force=3.1, speed=None, verdict="drops"),),
        causes=(
            GripCause(kind="regularized friction", sentence="friction is regularized"),
            GripCause(kind="weak squeeze", sentence="the squeeze is weak"),
        ),
        fixes=(
            GripFix(name="elliptic cones", options={"cone": "elliptic"}, speed=1e-5,
                    verdict="holds", worse=False, time_ratio=None,
                    lines=("hand.xml:3: <option cone=elliptic>",)),
            GripFix(name="double squeeze", options={}, speed=2e-3, verdict="creeps", worse=True,
                    time_ratio=None, lines=(), no_patch_reason="a control is no setting"),
        ),
        notes=("the hand is alone",),
    )  # fmt: skip


def gradients(*, mapped: bool) -> GradientsReport:
    known = Difference(value=1.25, bound=0.5, span=0.01)
    one = GradientInput(
        value=2.0, model=known, run=Difference(value=3.5, bound=0.25, span=0.001),
        methods={"chain": None}, verdicts={"run": "differs", "chain": "unknown"}, ladder=(),
    )  # fmt: skip
    place = GradientPlace(settings={}, end=0.5, mode="apart, stick", inputs={"speed": one})
    counts = {"agrees": 1, "differs": 3}
    band = Band(parameter="speed", method="run", counts=counts, share=0.75, widths={"height": 0.02})
    return GradientsReport(
        source="map.yaml", scene="toss", scene_hash=HASH, mujoco="4.0.0", engines={},
        output_coordinate="ball.z", duration=1.5, steps=(0.002, 0.0005), tolerance=0.1,
        axes={"height": (1.0, 2.0)} if mapped else {}, places=(place,) * (4 if mapped else 1),
        bands=(band,) if mapped else (), mode_switches=2, notes=("mjx is missing",),
    )  # fmt: skip


def panel() -> EnginePanel:
    common: dict[str, Any] = {"task": "bounce", "step": 0.002, "accuracy": None, "energy": None}
    ours = PanelRun(engine="mujoco", error=0.02, depth=1e-3, cost=0.25, label="stable", **common)
    other = PanelRun(engine="drake", error=1e-4, depth=1e-3, cost=None, label="stable", **common)
    return EnginePanel(
        engines={"mujoco": "4.0.0", "drake": "1.30"},
        tasks=(PanelTask(name="bounce", description="a ball", measure="height"),),
        runs=(ours, other),
        skipped=("bullet is not installed",),
    )


def shrunk() -> ShrinkReport:
    return ShrinkReport(
        run="0f3a", label="tunneling", reason="mug passed the table", stored_reason="as before",
        before={"bodies": 12, "joints": 4}, after={"bodies": 2, "joints": 4}, start_time=0.5,
        duration=0.25, stored_duration=4.0, models_run=81, finished=False, seconds=59.6,
        folder="results/shrink/a folder",
    )  # fmt: skip


def stability() -> StabilityReport:
    case: dict[str, Any] = {"runs": 8, "expected": 8, "labels": {"stable": 7}, "step": 12}
    case |= {"error": float("nan"), "seconds": 3.25, "store": "results/x", "skipped": ()}
    good = StabilityResult(name="wedge", as_expected=8, controls=1, misses=(), **case)
    bad = StabilityResult(name="pile", as_expected=7, controls=0, misses=("0f3a: lost",), **case)
    return StabilityReport((good, bad))


def fitted() -> FitReport:
    settings = (
        FittedSetting(
            name="friction", value=0.75, interval=(0.5, 0.9), profile={}, identified=True
        ),
        FittedSetting(name="cone", value="elliptic", interval=None, profile={}, identified=False),
    )
    return FitReport(
        scene="toss", scene_hash=HASH, metric="reality", settings=settings, fitted_runs=(1.0, 2.0),
        fitted_error=0.012, held_out={"3": 0.02, "4": 0.01}, held_out_error=0.015,
        held_out_interval=(0.01, 0.02), current_error=0.04, noise_floor=0.003, lines=(), runs=1234,
    )  # fmt: skip


def effects() -> EffectsReport:
    ratio = TimeRatio.of(0.75, 0.5, 1.0)
    return EffectsReport(
        model="robot.xml", scene_hash=HASH, mujoco="4.0.0", task=task(), scenarios=1, tilt=5.0,
        tolerance=0.1,
        effects=(
            PartEffect(kind="geom", name="toe", verdict="needed", error=0.25, body="foot",
                       phase="held", time_ratio=ratio, reason="", can_go=False),
            PartEffect(kind="pair", name="2 pairs of bodies", verdict="unused", error=None,
                       members=("a - b", "a - c"), time_ratio=ratio, reason="they cannot touch",
                       can_go=True),
            PartEffect(kind="limit", name="knee", verdict="not measured", error=None,
                       time_ratio=None, reason="", can_go=False),
        ),
        noise_floor=None, smaller=None, kept={"noslip": "creep 0 -> 1 mm/s"},
        sentence="No smaller model", timed_out=True, seconds=12.0,
    )  # fmt: skip


def forecast() -> SweepForecast:
    sizes = {"messages": (1.25e6, 3.5e9), "compact": (1e5, 2e6)}
    return SweepForecast(
        start="home",
        drive="sines and pushes",
        axes=(PlannedAxis(name="timestep", role="numerical", count=2, values="0.001, 0.002"),),
        seeds=3, runs=1200, least_runs=300, steps=120_000, seconds=(4.0, 130.0),
        accuracy_seconds=2.5, timing_seconds=0.0, memory_bytes=6e8,
        bytes=sizes["messages"], bytes_by_format=sizes, trace="unstable+1000",
        trace_format="messages", warnings=("12 of 1,200 runs have a long timestep",),
    )  # fmt: skip


def verification(*, sound: bool) -> StoreVerification:
    return StoreVerification(
        store="results/mug", sound=sound, problems=() if sound else ("traces/a.mcap: missing",),
        unverified=("records of 3 runs: 1 was drawn",), runs=4, traces=1, traces_left_out=sound,
        digest=HASH, physics=HASH if sound else "",
    )  # fmt: skip


def replay(*, equal: bool) -> RunReplay:
    return RunReplay(
        run_id="ab12", equal=equal, stored_hash="1" * 16, hash=HASH,
        step=None if equal else 17, difference=None if equal else 0.00123,
        stored_engine="mujoco 4.0.0", damage=None if equal else "a.mcap: changed",
    )  # fmt: skip


def bisection() -> Bisection:
    return Bisection(
        before="3.11.0", after="4.0.0", skipped={"3.12.0": "no such wheel"}, steps=2,
        comparison=None, folder=Path("results/bisect/test_a"),
    )  # fmt: skip


def explanation() -> Explanation:
    texts = ("Contacts press and part in turn.", "limit chatter_rate: 20 1/s. By eye.")
    meaning = WordMeaning(word="chatter", title="chatter: a label", texts=texts)
    return Explanation(meanings=(meaning, meaning.model_copy(update={"texts": ()})))


REPORTS: Mapping[str, DescribedReport] = {
    "forecast": forecast(),
    "forecast of a grid": forecast().model_copy(update={"least_runs": None, "runs": 12}),
    "sound store": verification(sound=True),
    "damaged store": verification(sound=False),
    "equal replay": replay(equal=True),
    "other replay": replay(equal=False),
    "bisection": bisection(),
    "meanings": explanation(),
    "expansion": ExpandedTraces(folder=Path("messages"), traces=2, bytes=4_300_000),
    "bundle": WrittenBundle(folder=Path("bundle"), runs=1, refused={}),
    "grip": grip(),
    "gradients of one place": gradients(mapped=False),
    "gradients of a map": gradients(mapped=True),
    "panel": panel(),
    "shrink": shrunk(),
    "stability": stability(),
    "fit": fitted(),
    "effects": effects(),
}
