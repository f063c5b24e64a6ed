"""Models with a planted need keep it; one with planted waste loses that, and moves as before."""

from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from contactlab.schema.coverage import Exercised
from contactlab.schema.study_reports import TuneReport
from contactlab.studies.session import Session
from contactlab.studies.tune.knobs import space_of
from contactlab.studies.tune.tune_request import TuneRequest
from contactlab.studies.tune.tuning import run

MODELS = Path(__file__).parent / "planted"
TOP = (MODELS / "top.xml").read_text(encoding="utf-8")
# The box would slide if the friction of 1 were not enough for a slope of 35 degrees, and creeps
# without noslip: (1 - d0) / (d0 b) of gravity along the slope, with b of 100/s, is 0.6 mm/s.
SLOPE = (MODELS / "slope.xml").read_text(encoding="utf-8")
# A bottle stands on its rim: of contacts with a mesh, one is not enough to carry it upright.
BOTTLE = (MODELS / "bottle.xml").read_text(encoding="utf-8")
# Contacts ask for 1 ms, and refsafe gives them two steps.
STIFF = (MODELS / "stiff.xml").read_text(encoding="utf-8")
# A mug hangs between two fingers that press on it 2 cm off its centre of mass: only torsional
# friction holds it level. Each finger presses with 20 N, so that two contacts of 1 cm resist
# 0.4 N m against a weight of 0.1 kg at 2 cm, 0.02 N m.
MUG = (MODELS / "mug.xml").read_text(encoding="utf-8")
MOTOR = (MODELS / "motor.xml").read_text(encoding="utf-8")
LIMIT = (MODELS / "limit.xml").read_text(encoding="utf-8")
LOOP = (MODELS / "loop.xml").read_text(encoding="utf-8")
# Boxes at rest spin and rub nowhere, and their contacts have six dimensions for nothing.
REST = (MODELS / "rest.xml").read_text(encoding="utf-8")
WASTE = (MODELS / "waste.xml").read_text(encoding="utf-8")


Break = Callable[[mujoco.MjModel], None]


def with_condim(dimensions: int) -> Break:
    def without(model: mujoco.MjModel) -> None:
        model.geom_condim[:] = dimensions

    return without


def without_noslip(model: mujoco.MjModel) -> None:
    model.opt.noslip_iterations = 0


def disabled(flag: mujoco.mjtDisableBit) -> Break:
    def without(model: mujoco.MjModel) -> None:
        model.opt.disableflags |= int(flag)

    return without


OFF = mujoco.mjtDisableBit
NEEDS = {
    "torsional friction that stops a top": (TOP, 0.1, with_condim(3)),
    "friction that holds a mug": (MUG, 0.15, with_condim(3)),
    "noslip that holds a box on a slope": (SLOPE, 0.2, without_noslip),
    "multiccd that lets a bottle stand": (BOTTLE, 0.1, disabled(OFF.mjDSBL_MULTICCD)),
    "refsafe of stiff contacts": (STIFF, 0.1, disabled(OFF.mjDSBL_REFSAFE)),
    "a motor that moves": (MOTOR, 0.2, disabled(OFF.mjDSBL_ACTUATION)),
    "a limit that stops": (LIMIT, 0.2, disabled(OFF.mjDSBL_LIMIT)),
    "a loop that closes": (LOOP, 0.2, disabled(OFF.mjDSBL_EQUALITY)),
}


def tuned(
    folder: Path, text: str, seconds: float, error: float | None = None, free: Sequence[str] = ()
) -> TuneReport:
    """Tune a model for short runs, as a sweep asks."""
    (folder / "model.xml").write_text(text)
    sweep = folder / "short.yaml"
    sweep.write_text(f"{{version: 1, scene: model.xml, drive: none, duration: {seconds}}}")
    request = TuneRequest(str(sweep), error=error, budget=1e9, free=free)
    return run(request, Session(folder / ("free" if free else "out")))


def final(model: mujoco.MjModel, seconds: float) -> np.ndarray:
    """Return where points 5 cm from the origins of bodies end, by plain MuJoCo [m]."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, nstep=round(seconds / model.opt.timestep))
    mujoco.mj_kinematics(model, data)
    axes = 0.05 * data.xmat.reshape(-1, 3, 3).swapaxes(1, 2)
    return data.xpos[:, None] + axes


def rows(model: mujoco.MjModel) -> int:
    """Return how many constraint rows a model has at rest."""
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=100)
    return int(data.nefc)


def kept(report: TuneReport, *names: str) -> bool:
    return not {each.name for each in report.changes} & set(names)


@pytest.mark.night
@pytest.mark.parametrize("need", NEEDS)
def test_what_the_motion_needs_stays(tmp_path: Path, need: str) -> None:
    """The model that is recommended ends where the model as written does; without the need, not.

    Both are within the limit of the same reference, so that they are within twice as much.
    """
    text, seconds, take_away = NEEDS[need]
    report = tuned(tmp_path, text, seconds)
    file = tmp_path / "out" / report.file if report.file else tmp_path / "model.xml"
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    end, most = final(written, seconds), 2 * report.limits["error_peak"]
    found = final(mujoco.MjModel.from_xml_path(str(file)), seconds)
    assert np.abs(found - end).max() <= most
    take_away(written)
    assert not np.abs(final(written, seconds) - end).max() <= most


@pytest.mark.night
def test_what_no_run_exercised_goes_on_request_only(tmp_path: Path) -> None:
    """Contacts at rest carry nothing in their further rows, which may matter to other runs."""
    text = REST.replace('condim="3"', 'condim="6"')
    names = ("torsional_friction", "rolling_friction")
    report = tuned(tmp_path, text, 0.2, free=names)
    assert report.file is not None
    tuned_model = mujoco.MjModel.from_xml_path(str(tmp_path / "free" / report.file))
    original, wasteful = map(mujoco.MjModel.from_xml_string, (REST, text))
    assert rows(wasteful) >= 2 * rows(original)
    assert rows(tuned_model) <= 1.2 * rows(original)
    assert np.abs(final(tuned_model, 0.2) - final(original, 0.2)).max() <= 1e-5
    asked = tuned(tmp_path, text, 0.2)
    assert kept(asked, *names)
    said = {each.name: each.reason for each in asked.kept}
    assert all(said[name].endswith(f"or --free {name}") for name in names)


def test_refsafe_is_nothing_to_search(tmp_path: Path) -> None:
    """What guards against settings, and what a model is made of, is no knob."""
    path = tmp_path / "model.xml"
    path.write_text(STIFF)
    setup = TuneRequest(str(path)).setup
    every = Exercised.of([{"coverage": None}])
    space, _ = space_of(setup, every, ())
    names = {name for knob in space.knobs for each in knob.values for name in each}
    guards = {
        "refsafe",
        "contact",
        "gravity",
        "actuation",
        "limit",
        "equality",
        "damper",
        "friction",
    }
    assert names
    assert not names & guards


@pytest.mark.night
def test_what_never_touches_and_short_steps_go(tmp_path: Path) -> None:
    report = tuned(tmp_path, WASTE, 0.4, 1e-4)
    assert report.proof is not None
    assert report.proof.holds
    assert {"dress", "a", "b"} == set(report.masked)
    assert {each.name for each in report.changes} & {"timestep", "integrator"}
    assert report.proof.tuned.error_peak is not None
    assert report.proof.tuned.error_peak <= 1e-4
    assert report.proof.same_runs == 10
