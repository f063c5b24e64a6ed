"""Labels after 1, 2 and 5 s are the same, since creep, sinking and sag are rates."""

from pathlib import Path

import pytest

from contactlab.engines import Buffers, PreparedRuns
from contactlab.engines.mujoco_engine import MujocoEngine
from contactlab.engines.rollout_trace import make_trace
from contactlab.measure import assess_runs
from contactlab.scene.run_setup import make_setup
from contactlab.scene.scene import Scene

SLOPE = """<mujoco>
<option gravity="{pull} 0 -9.6" cone="{cone}" impratio="{impratio}" timestep=".004"/>
<default><geom friction=".6" solimp=".9 .9 .001" solref="{solref} 1"/></default>
<worldbody><geom type="plane" size="9 9 .1"/>
<body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="1"/></body>{upper}</worldbody>
</mujoco>"""
UPPER = '<body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1" mass="{}"/></body>'.format
BRAKE = """<mujoco><option timestep=".002"/>
<worldbody><body><joint axis="0 1 0" frictionloss="{loss}" solreffriction="{constant} 1"
 solimpfriction="{impedance} {impedance} .001"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1"/></body></worldbody></mujoco>"""
HUNG = """<mujoco><option timestep=".002"/><worldbody><body name="hung" pos="0 0 1"><freejoint/>
<geom type="box" size=".05 .05 .05" mass="1"/></body></worldbody>
<equality><weld body1="hung" solref="{constant} 1"/></equality></mujoco>"""
TENDON_BRAKE = """<mujoco><option timestep=".002"/>
<worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass="1"/></body></worldbody>
<tendon><fixed frictionloss="6" solreffriction=".1 1" solimpfriction=".5 .5 .001">
<joint joint="hinge" coef="1"/></fixed></tendon></mujoco>"""
STOP = """<mujoco><option timestep=".002"/><worldbody><body pos="0 0 1"><joint type="slide"
 axis="0 0 1" limited="true" range="-.01 1" solreflimit="{constant} 1"/>
<geom size=".1" mass="1"/></body></worldbody></mujoco>"""


def slope(
    pull: float, impratio: float = 1, upper: float = 0, solref: float = 0.02, cone: str = "elliptic"
) -> str:
    stacked = UPPER(upper) if upper else ""
    return SLOPE.format(pull=pull, impratio=impratio, upper=stacked, solref=solref, cone=cone)


# The first five were looked at while the rates were written; the others were held back.
MODELS = {
    "crate at rest": slope(0),
    "crate on a slope": slope(2),
    "loaded crate on a slope": slope(1.5, upper=14),
    "loaded crate with impratio 50": slope(2, impratio=50, upper=20),
    "strong brake": BRAKE.format(loss=6, constant=0.02, impedance=0.9),
    "steep slope": slope(4.5),
    "soft crate on a slope": slope(2, solref=0.05),
    "soft crate on a steep slope": slope(4.5, solref=0.05),
    "stiff crate on a steep slope": slope(4.5, solref=0.01),
    "pyramids": slope(3, cone="pyramidal"),
    "loaded pyramids": slope(2, upper=10, cone="pyramidal"),
    "twenty to one at rest": slope(0, upper=20),
    "brake at its limit": BRAKE.format(loss=2.2, constant=0.02, impedance=0.9),
    "soft brake": BRAKE.format(loss=6, constant=0.1, impedance=0.9),
    "softer brake": BRAKE.format(loss=6, constant=0.1, impedance=0.5),
    "stiff brake": BRAKE.format(loss=6, constant=0.02, impedance=0.99),
    "softer tendon brake": TENDON_BRAKE,
    "weld": HUNG.format(constant=0.02),
    "softer weld": HUNG.format(constant=0.06),
    "stop": STOP.format(constant=0.02),
    "soft stop": STOP.format(constant=0.08),
}
CREEPING = ("loaded crate on a slope", "soft brake", "softer brake", "softer tendon brake")


def labels_after(path: Path, seconds: float) -> list[str]:
    scene, engine = Scene.open(str(path)), MujocoEngine()
    run = scene.resolve({}, 0, seconds)
    runs = PreparedRuns.of(scene, run)
    trace = make_trace(runs.base, runs.prepared, engine.roll_out(runs, Buffers()))
    setup = make_setup(runs.base, scene.source.manifest, [run], runs.models, {})
    return [found.label for found in assess_runs(trace, setup).labels[0]]


@pytest.mark.parametrize(
    "name",
    [
        name if place % 5 == 2 else pytest.param(name, marks=pytest.mark.long)
        for place, name in enumerate(MODELS)
    ],
)
def test_labels_are_the_same_after_any_duration(tmp_path: Path, name: str) -> None:
    (tmp_path / "model.xml").write_text(MODELS[name])
    found = [labels_after(tmp_path / "model.xml", seconds) for seconds in (1.0, 2.0, 5.0)]
    assert found[0] == found[1] == found[2]
    if name in CREEPING:
        assert found[0] != ["stable"]
