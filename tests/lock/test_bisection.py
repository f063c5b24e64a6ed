"""Which release changed an outcome: the search by itself, and sweeps of stand-in releases."""

import math
import shutil
import subprocess
from pathlib import Path

import mujoco
import pytest
from hypothesis import given
from hypothesis import strategies as st

import contactlab
from contactlab.comparison.compare_stores import DEFAULT_POLICY
from contactlab.errors import (
    EngineError,
    ExpectationError,
    PolicyError,
    StoppedError,
    SweepFileError,
)
from contactlab.resources import MODELS
from contactlab.studies.lock import versions
from contactlab.studies.lock.bisection import SweepOutcomes, find_change, remember_outcome
from contactlab.studies.lock.versions import find_releases, run_sweep, run_test


def ignore(_: str) -> None:
    pass


@given(st.integers(2, 70).flatmap(lambda n: st.tuples(st.just(n), st.integers(1, n - 1))))
def test_one_change_is_found_in_log2_steps(case: tuple[int, int]) -> None:
    count, first = case
    asked: list[int] = []

    def differs(version: str) -> bool:
        asked.append(int(version))
        return int(version) >= first

    found = find_change([str(each) for each in range(count)], differs, ignore)
    assert (found.before, found.after) == (str(first - 1), str(first))
    assert len(asked) == found.steps <= math.ceil(math.log2(max(1, count - 1)))
    assert not {0, count - 1} & set(asked)


@given(st.lists(st.sampled_from(["as", "other", "broken"]), max_size=30))
def test_neighbours_differ_whatever_lies_between(middle: list[str]) -> None:
    gives = ["as", *middle, "other"]
    numbers = [str(each) for each in range(len(gives))]

    def differs(version: str) -> bool:
        if gives[int(version)] == "broken":
            raise EngineError("no such wheel\nand more")
        return gives[int(version)] == "other"

    found = find_change(numbers, differs, ignore)
    before, after = int(found.before), int(found.after)
    assert (gives[before], gives[after]) == ("as", "other")
    assert {int(each) for each in found.skipped} == {*range(before + 1, after)}
    assert set(gives[before + 1 : after]) <= {"broken"}
    assert set(found.skipped.values()) <= {"no such wheel"}


def test_an_interrupted_sweep_is_no_release_to_leave_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ended = subprocess.CompletedProcess[str]([], StoppedError.exit_code, "")
    monkeypatch.setattr(versions, "run_python", lambda *_: ended)

    def differs(version: str) -> bool:
        run_sweep("slide", tmp_path / version, version, [], ignore)
        return True

    with pytest.raises(StoppedError, match="again to resume"):
        find_change(["1.0", "1.1", "1.2"], differs, ignore)


SLIDE = {"version": 1, "duration": 0.6, "axes": {"cone": ["elliptic"]}}
SINCE = {"1.0": 0.5, "1.1": 0.5, "1.2": 0.6, "1.3": 0.6, "1.4": 0.6}


@pytest.fixture
def ran() -> list[str]:
    return []


@pytest.fixture
def slides(tmp_path: Path, ran: list[str]) -> SweepOutcomes:
    """A sweep under releases, of which those since 1.2 have more friction."""

    def run(store: Path, version: str) -> None:
        scene = tmp_path / f"scene-{version}"
        if not store.exists():
            ran.append(version)
            shutil.copytree(MODELS / "box_slide", scene)
            (model,) = scene.glob("*.xml")
            text = model.read_text()
            model.write_text(text.replace('friction="0.5 ', f'friction="{SINCE[version]} '))
        contactlab.sweep({**SLIDE, "scene": str(scene)}, output=store, workers=0)

    return SweepOutcomes(tmp_path, run, DEFAULT_POLICY)


@pytest.mark.long
def test_a_release_that_changed_friction_is_found_with_the_run(
    slides: SweepOutcomes, ran: list[str]
) -> None:
    slides.begin("1.0", "1.4")
    found = find_change(list(SINCE), slides.differs, ignore)
    assert (found.before, found.after) == ("1.1", "1.2")
    shown = {each.name: each for each in slides.report_change(found).findings}
    slip = shown["slip_distance unchanged"]
    (pair,) = slip.worst
    assert pair.candidate_run
    assert isinstance(pair.baseline, float)
    assert isinstance(pair.candidate, float)
    # v^2 / (2 mu g), to the scene's own tolerance and creep.
    assert pair.candidate / pair.baseline == pytest.approx(0.5 / 0.6, rel=0.03)
    assert sorted(ran) == ["1.0", "1.1", "1.2", "1.4"]

    again = SweepOutcomes(slides.folder, slides.run, DEFAULT_POLICY, ["slip_distance unchanged"])
    again.begin("1.0", "1.4")
    assert find_change(list(SINCE), again.differs, ignore) == found
    assert len(ran) == 4


@pytest.mark.long
def test_equal_ends_and_unknown_questions_are_errors(slides: SweepOutcomes) -> None:
    with pytest.raises(ExpectationError, match=r"1\.0 and 1\.1 give the same"):
        slides.begin("1.0", "1.1")
    asks = SweepOutcomes(slides.folder, slides.run, DEFAULT_POLICY, ["slip_distances unchanged"])
    with pytest.raises(PolicyError, match="did you mean 'slip_distance unchanged'"):
        asks.begin("1.0", "1.2")


def test_a_test_runs_once_until_its_file_changes(tmp_path: Path) -> None:
    file, folder = tmp_path / "test_it.py", tmp_path / "3.9.0"
    folder.mkdir()
    file.write_text("first")
    outcomes = iter([True, False, True])

    def asked(name: str) -> bool:
        return remember_outcome(f"{file}::{name}", folder, lambda: next(outcomes))

    assert [asked("test_a"), asked("test_a")] == [True, True]
    assert [asked("test_b"), asked("test_b")] == [False, False]
    file.write_text("second")
    assert asked("test_b")


@pytest.mark.long
def test_pytest_says_whether_a_test_passes(tmp_path: Path) -> None:
    file = tmp_path / "test_it.py"
    file.write_text("def test_a(): pass\n\ndef test_b(): raise ValueError('why')\n")

    def passes(name: str) -> bool:
        return run_test(f"{file}::{name}", tmp_path / name, mujoco.__version__, ignore)

    assert passes("test_a")
    assert not passes("test_b")
    assert "ValueError: why" in (tmp_path / "test_b" / "pytest.txt").read_text()
    with pytest.raises(SweepFileError, match=r"exit code 4; see .*test_c/pytest\.txt"):
        passes("test_c")


def test_releases_lead_from_the_one_to_the_other() -> None:
    listed = ["3.10.0", "3.9.0", "3.3.4", "4.0.0"]
    assert find_releases("3.9.0", "4.0.0", listed) == ["3.9.0", "3.10.0", "4.0.0"]
    assert find_releases("3.10.0", "3.3.4", listed) == ["3.10.0", "3.9.0", "3.3.4"]
    with pytest.raises(EngineError, match=r"no release 3\.8\.0"):
        find_releases("3.8.0", "4.0.0", listed)
    with pytest.raises(EngineError, match="name two releases"):
        find_releases("4.0.0", "4.0.0", listed)
    with pytest.raises(EngineError, match="'new' is not a release"):
        find_releases("3.9.0", "4.0.0", [*listed, "new"])


TUMBLE = """
version: 1
scene: tumbling_box
duration: 20
axes: {integrator: [implicitfast], timestep: [0.01]}
"""


@pytest.mark.night
def test_a_change_of_a_real_release_is_found(tmp_path: Path) -> None:
    """docs/how-to/upgrading.md: implicitfast loses the energy of free rotation since 3.11.0."""
    file = tmp_path / "tumble.yaml"
    file.write_text(TUMBLE)

    def run(store: Path, version: str) -> None:
        run_sweep(str(file), store, version, ["--workers=0"], ignore)

    subject = SweepOutcomes(tmp_path / "stores", run, DEFAULT_POLICY)
    try:
        listed = find_releases("3.10.0", "3.13.0")
        subject.begin(listed[0], listed[-1])
    except EngineError as error:
        pytest.skip(str(error))
    found = find_change(listed, subject.differs, ignore)
    assert (found.before, found.after) == ("3.10.0", "3.11.0")
    assert "no new energy_loss" in {each.name for each in subject.report_change(found).findings}


def test_a_test_is_bisected_to_the_release_that_changes_its_outcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    releases = [f"3.{number}.0" for number in range(1, 9)]
    monkeypatch.setattr(versions, "find_releases", lambda *_: releases)

    def passes(_node: str, folder: Path, version: str, _notify: object) -> bool:
        folder.mkdir(parents=True)
        return version < "3.6"

    monkeypatch.setattr(versions, "run_test", passes)
    found = contactlab.bisect(
        f"{tmp_path}/test_a.py::test_b", good="3.1.0", bad="3.8.0", output=tmp_path / "out"
    )
    assert (found.before, found.after) == ("3.5.0", "3.6.0")
    assert found.comparison is None
