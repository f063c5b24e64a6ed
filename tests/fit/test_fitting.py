"""A fit finds planted settings again, tells what it cannot tell, and is resumed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.planted_recordings import TRIALS, WIDTH, plant

import contactlab
from contactlab.contact.trace_arrays import Floats
from contactlab.errors import SceneError, SweepFileError
from contactlab.schema.study_reports import FIT_REPORT, FitReport
from contactlab.studies.fit import fitting
from contactlab.studies.fit.fitting import FitRequest, fit_settings
from contactlab.tasks.session import Session

FITTED = 12


@pytest.mark.night
@pytest.mark.parametrize("true", [0.15, 0.4])
def test_planted_friction_is_found_and_stiffness_is_not(tmp_path: Path, true: float) -> None:
    """A puck that slides tells its friction; how stiff the floor is does not move it."""
    scene = plant(tmp_path / "puck", true, seed=7)
    request = FitRequest(scene, ["friction.slide", "solref.timeconst=0.015:0.03"], fitted=FITTED)
    begun: list[tuple[int, int]] = []
    session = Session(tmp_path / "fit", begin=lambda total, done, *_: begun.append((total, done)))
    report = fit_settings(request, session)
    friction, stiffness = report.settings
    assert friction.interval is not None
    low, high = friction.interval
    assert low <= true <= high
    assert high < 1.2 * low
    assert friction.identified
    assert not stiffness.identified
    assert stiffness.interval is not None
    assert stiffness.interval[0] <= 0.02 <= stiffness.interval[1]
    assert report.held_out_error < 0.1 * report.current_error
    assert len(report.held_out) == TRIALS - FITTED
    assert not set(map(float, report.held_out)) & set(report.fitted_runs)
    text = (tmp_path / "fit" / "fitted" / "fitted.xml").read_text()
    assert f'friction="{friction.value:.6g}' in text
    stored = FitReport.model_validate_json((tmp_path / "fit" / FIT_REPORT).read_bytes())
    assert stored == report
    begun.clear()
    assert fit_settings(request, session) == report
    assert all(total == done for total, done in begun)


@pytest.mark.night
def test_intervals_have_what_recordings_were_made_with(tmp_path: Path) -> None:
    """Of four intervals of 95 % two miss by chance in one of 70 such tests.

    With the noise of sensors, of few runs; bench/planted_truth.py counts a hundred cases.
    """
    true, free, within = (0.3, 0.012), ["friction.slide", "solref.timeconst=0.005:0.06"], 0
    noise = "perturb: {coordinates: [puck.x], scale: 1.0e-4}\n"
    for name, tossed in (("slid", False), ("tossed", True)):
        scene = plant(tmp_path / name, true[0], 3, timeconst=true[1], tossed=tossed, trials=9)
        output = tmp_path / f"fit-{name}"
        manifest = tmp_path / name / "scene.yaml"
        manifest.write_text(manifest.read_text() + noise)
        report = contactlab.fit(scene, free=free, fitted=6, output=output, workers=0)
        # A start 0.1 mm off moves the mean distance by as much, and by what an impact adds.
        assert report.noise_floor is not None
        assert 0 < report.noise_floor <= 3 * 1e-4 / WIDTH
        assert len(report.fitted_runs) == 6
        for value, each in zip(true, report.settings, strict=True):
            assert each.interval is not None
            within += each.interval[0] <= value <= each.interval[1]
    assert within >= 3


@pytest.mark.night
def test_a_fit_to_one_strange_run_shows_on_those_held_out(tmp_path: Path) -> None:
    """Fitted to two runs on another floor, the error of the others is far larger."""
    scene = plant(tmp_path / "puck", 0.3, seed=7)
    path = tmp_path / "puck" / "motion.csv"
    other = plant(tmp_path / "other", 0.05, seed=7)
    strange = (Path(other) / "motion.csv").read_text().splitlines()
    order = np.random.default_rng(0).permutation(TRIALS)[:2]
    lines = path.read_text().splitlines()
    both = zip(lines, strange, strict=True)
    mixed = [b if b.split(",")[0] in map(str, order) else a for a, b in both]
    path.write_text("\n".join(mixed) + "\n")
    report = fit_settings(
        FitRequest(scene, ["friction.slide"], fitted=2), Session(tmp_path / "fit")
    )
    assert report.held_out_error > 5 * report.fitted_error


@pytest.mark.parametrize(
    ("free", "message"),
    [
        ("frictoin", "no such axis"),
        ("gravity", "write bounds above 0, such as gravity=0.1:10"),
        ("friction.slide=2:1", "write bounds above 0"),
        ("friction.slide=low:high", "write bounds above 0"),
    ],
)
def test_wrong_settings_are_named(tmp_path: Path, free: str, message: str) -> None:
    scene = plant(tmp_path / "puck", 0.3, seed=1)
    with pytest.raises(SweepFileError, match=message):
        fit_settings(FitRequest(scene, [free]), Session(tmp_path / "fit"))


def test_a_scene_without_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="a fit needs a `recording` of three runs or more"):
        fit_settings(FitRequest("box_slide", ["friction.slide"]), Session(tmp_path))


def test_a_search_knows_nothing_of_the_runs_held_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Errors are how far log friction is from a truth, so that nothing has to be simulated."""
    true, asked = 0.3, dict[str, set[float]]()

    def errors(_: Any, name: str, settings: Sequence[Any], runs: Sequence[float]) -> Floats:
        asked.setdefault(name, set()).update(runs)
        slides = [each.get("friction.slide", 1.0) for each in settings]
        scatter = 1e-3 * (1 + np.arange(len(runs)) % 3)
        return np.asarray(np.abs(np.log(np.array(slides) / true))[:, None] + scatter, np.float64)

    monkeypatch.setattr(fitting._Trials, "run", errors)  # pyright: ignore[reportPrivateUsage]
    scene = plant(tmp_path / "puck", true, seed=1)
    report = fit_settings(
        FitRequest(scene, ["friction.slide"], fitted=FITTED), Session(tmp_path / "fit")
    )
    held_out = set(map(float, report.held_out))
    assert asked["held-out"] == asked["as-written"] == held_out
    for name, runs in asked.items():
        assert name in {"held-out", "as-written", "noise"} or not runs & held_out
    assert len(held_out) + len(report.fitted_runs) == TRIALS
    (friction,) = report.settings
    # Points are drawn around the best until their spread is the least, 1 % of the range or so.
    assert abs(np.log(float(str(friction.value)) / true)) < 0.1
