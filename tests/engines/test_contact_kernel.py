"""The kernel leaves every bit that contact sensors leave, or stays out of the way."""

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.sanitizers import run_sanitized

from contactlab import resources
from contactlab.contact.trace_arrays import Trace
from contactlab.engines import ENGINES, Buffers, PreparedRuns, Rollout, contact_kernel
from contactlab.engines.contact_kernel import compiled_kernel
from contactlab.engines.rollout_trace import make_trace
from contactlab.errors import CompilerError
from contactlab.plan.overrides import Overrides
from contactlab.run.sweep_request import SweepRequest, read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.scene.mujoco_versions import has_batch, silence_mujoco
from contactlab.scene.scene import Scene

pytestmark = pytest.mark.skipif(not has_batch(), reason="needs a batch: MuJoCo 3.17 or newer")

SWITCH = "CONTACTLAB_KERNEL"
CATALOGUE = sorted((resources.SWEEPS / "stability").glob("*.yaml"))
# Cases as they are written take minutes: `make kernel` runs them so, and by one to four workers.
# Else they have one seed, a second at most, and no second pass.
AS_WRITTEN = "WHOLE_CATALOGUE" in os.environ
SHORT = ("seeds=1", "checks=none")
MOST_SECONDS = 1.0
# Everything that decides which contacts there are, in what order, and what they bear.
SETTINGS: list[dict[str, Any]] = [
    {"integrator": "Euler"},
    {"integrator": "RK4", "cone": "elliptic"},
    {"integrator": "RK4", "fwdinv": True, "solver": "CG"},
    {"integrator": "implicit", "cone": "elliptic"},
    {"integrator": "implicitfast", "cone": "elliptic", "condim": 6},
    {"margin": 0.01, "gap": 0.005, "solver": "PGS", "noslip_iterations": 3},
    {"solver": "CG", "jacobian": "sparse", "gravity": (1.0, 0.5, -9.0), "condim": 1},
]
EXPLODING: dict[str, Any] = {"timestep": 0.02, "solref": (-1e12, -1.0)}
_SHAPES = ("sphere", "capsule", "cylinder", "box", "ellipsoid")


@pytest.fixture(autouse=True)
def anew(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Begin and end as a process does that has not used the kernel yet."""
    silence_mujoco()
    monkeypatch.delenv(SWITCH, raising=False)
    contact_kernel.load_kernel.cache_clear()
    yield
    contact_kernel.load_kernel.cache_clear()


@pytest.fixture
def kernel() -> contact_kernel.Kernel:
    """Return the kernel, where there is a compiler."""
    try:
        compiled_kernel()
    except CompilerError as error:
        pytest.skip(str(error))
    loaded = contact_kernel.load_kernel()
    assert isinstance(loaded, contact_kernel.Kernel)
    return loaded


def rolled(runs: PreparedRuns, way: str, monkeypatch: pytest.MonkeyPatch) -> tuple[Rollout, Trace]:
    monkeypatch.setenv(SWITCH, way)
    rollout = ENGINES["mujoco"].roll_out(runs, Buffers())
    return rollout, make_trace(runs.base, runs.prepared, rollout)


@pytest.mark.parametrize("way", ["", "off"])
def test_as_many_runs_go_at_once_as_memory_holds(
    kernel: contact_kernel.Kernel, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    """Equal stacks rest alike, so that each run takes as much; the first goes whatever it takes."""
    del kernel
    scene = Scene.open("box_stack")
    runs = PreparedRuns.of(scene, *(scene.resolve({"boxes": 2}, each, 0.1) for each in range(6)))
    whole, _ = rolled(runs, way, monkeypatch)
    arrays = [whole.state, whole.sensors, whole.iterations, *(whole.slots or ())]
    each = sum(array.nbytes for array in arrays) / 6
    for memory, count in ((0.0, 1), (1.5, 1), (3.5, 3), (6.5, 6)):
        some = ENGINES["mujoco"].roll_out(runs, Buffers(int(memory * each)))
        assert len(some.steps) == count
        assert np.array_equal(some.state, whole.state[:count])


def assert_same_bits(
    runs: PreparedRuns, monkeypatch: pytest.MonkeyPatch, *, read: bool = True
) -> Trace:
    """Compare all that both ways record, up to where each run stopped; slots left out are empty."""
    (by_kernel, seen), (by_sensors, expected) = (
        rolled(runs, way, monkeypatch) for way in ("on", "off")
    )
    assert (by_kernel.slots is not None) == read
    assert by_sensors.slots is None
    for name in ("steps", "warnings", "errors", "passages"):
        assert getattr(by_kernel, name) == getattr(by_sensors, name)
    for run, steps in enumerate(by_sensors.steps):
        one, other = seen.select([run], steps), expected.select([run], steps)
        for name, value in vars(other).items():
            if isinstance(value, np.ndarray):
                assert getattr(one, name).tobytes() == value.tobytes(), name
        assert (one.held_pose is None) == (other.held_pose is None)
        if one.held_pose is not None and other.held_pose is not None:
            assert one.held_pose.position.tobytes() == other.held_pose.position.tobytes()
            assert one.held_pose.rotation.tobytes() == other.held_pose.rotation.tobytes()
        for pair, sensed in zip(one.pairs, other.pairs, strict=True):
            full = np.zeros_like(sensed.slots)
            full[:, :, : pair.slots.shape[2]] = pair.slots
            assert full.tobytes() == sensed.slots.tobytes(), pair.name
    return expected


def runs_of(scene: Scene, *values: dict[str, Any]) -> PreparedRuns:
    resolved = [scene.resolve(each, seed, None) for seed, each in enumerate(values)]
    return PreparedRuns.of(scene, *resolved)


@pytest.mark.usefixtures("kernel")
@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_contacts_are_those_of_sensors(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene.open("box_stack")
    trace = assert_same_bits(runs_of(scene, *[{"boxes": 3, **settings}] * 2), monkeypatch)
    assert all(pair.touching.any() for pair in trace.pairs)


@pytest.mark.usefixtures("kernel")
@pytest.mark.parametrize("name", ["grasp_mug", "collision_momentum", "free_fall", "ragdoll"])
def test_what_is_measured_beside_contacts_stays(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Forces of actuators, momenta, held poses, lengths and energies, and pairs of bodies."""
    scene = Scene.open(name)
    resolved = scene.resolve({}, 0, 0.3)
    assert_same_bits(PreparedRuns.of(scene, resolved), monkeypatch)


def random_geom(rng: np.random.Generator, place: float) -> str:
    """Return a shape, some with a margin or a gap, in which contacts bear nothing."""
    kind = rng.choice([*_SHAPES, "mesh"])
    size = 'mesh="cube"' if kind == "mesh" else 'size=".05 .04 .03"'
    return (
        f'<geom type="{kind}" {size} condim="{rng.choice([1, 3, 4, 6])}" pos="{place} 0 0" '
        f'margin="{rng.choice([0, 0, 0.01])}" gap="{rng.choice([0, 0, 0.02])}"/>'
    )


def random_model(seed: int) -> str:
    """Return shapes that fall onto each other, some of them two to a body or without a floor.

    Some lie where others do, so that their contacts tie; some bodies are welded to each other.
    """
    rng = np.random.default_rng(seed)
    bodies: list[str] = []
    for number in range(rng.integers(2, 6)):
        geoms = "".join(random_geom(rng, each * 0.05) for each in range(rng.integers(1, 3)))
        place = rng.uniform((-0.05, -0.05, 0), (0.05, 0.05, 0.4))
        place = np.round(place / 0.05) * 0.05 if rng.random() < 0.3 else place
        at = " ".join(f"{each:.3f}" for each in place)
        bodies.append(f'<body name="b{number}" pos="{at}"><freejoint/>{geoms}</body>')
    kind = rng.choice(['plane" size="1 1 .1', 'hfield" hfield="hills'], p=[0.7, 0.3])
    floor = f'<geom name="floor" type="{kind}"/>' if rng.random() < 0.8 else ""
    weld = '<equality><weld body1="b0" body2="b1"/></equality>' if rng.random() < 0.2 else ""
    hills = " ".join(f"{each:.1f}" for each in rng.random(25))
    cube = " ".join(f"{x} {y} {z}" for x in (0, 0.08) for y in (0, 0.08) for z in (0, 0.08))
    return (
        f'<mujoco><option cone="{rng.choice(["pyramidal", "elliptic"])}" timestep="0.002" '
        f'noslip_iterations="{rng.choice([0, 0, 3])}">'
        f'<flag multiccd="{rng.choice(["enable", "disable"])}"/></option>'
        f'<asset><mesh name="cube" vertex="{cube}"/><hfield name="hills" nrow="5" ncol="5" '
        f'size="1 1 .05 .1" elevation="{hills}"/></asset>'
        f"<worldbody>{floor}{''.join(bodies)}</worldbody>{weld}</mujoco>"
    )


def assert_same_on_random_models(
    seeds: range, make_scene: Callable[..., Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    touched = 0
    for seed in seeds:
        entries = ["bodies: [b0, b1]", "bodies: [b1, world]"] if seed % 2 else []
        entries += ["bodies: [b1, b0]"] if seed % 4 == 3 else []
        pairs = "pairs: [" + ", ".join(f"{{{each}, slots: 3}}" for each in entries) + "]\n"
        model = random_model(seed)
        if "floor" not in model:
            pairs = pairs.replace(", {bodies: [b1, world], slots: 3}", "")
        scene = make_scene(model, pairs if entries else "")
        trace = assert_same_bits(runs_of(scene, {}, {"gravity": (0, 1, -5)}), monkeypatch)
        touched += any(pair.touching.any() for pair in trace.pairs)
    assert touched > len(seeds) / 2


@pytest.mark.usefixtures("kernel")
def test_random_models(make_scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_same_on_random_models(range(8), make_scene, monkeypatch)


@pytest.mark.night
@pytest.mark.usefixtures("kernel")
def test_many_random_models(make_scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_same_on_random_models(range(8, 200), make_scene, monkeypatch)


@pytest.mark.usefixtures("kernel")
def test_runs_that_stop_or_fail_leave_what_they_did(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene.open("ball_drop")
    runs = runs_of(scene, {}, EXPLODING, {}, {"integrator": "RK4", **EXPLODING}, {})
    runs.models[2].geom_condim.fill(20)
    assert_same_bits(runs, monkeypatch)


@pytest.mark.usefixtures("kernel")
def test_a_pair_may_be_monitored_from_both_sides(
    make_scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
    <body name="box" pos="0 0 .05"><freejoint/><geom name="box" type="box" size=".05 .04 .05"/>
    </body></worldbody></mujoco>"""
    entries = ("geoms: [floor, box]", "geoms: [box, floor]", "bodies: [box, world], slots: 2")
    pairs = "pairs: [" + ", ".join(f"{{{each}}}" for each in entries) + "]\n"
    trace = assert_same_bits(runs_of(make_scene(model, pairs), {}), monkeypatch)
    assert [int(pair.found.max()) for pair in trace.pairs] == [4, 4, 4]


@pytest.mark.long
@pytest.mark.usefixtures("kernel")
def test_what_sleeps_is_left_to_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = runs_of(Scene.open("box_stack"), {"sleep": True})
    assert_same_bits(runs, monkeypatch, read=False)


@pytest.mark.usefixtures("kernel")
def test_a_run_may_be_awake_whose_scene_sleeps(
    make_scene: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = """<mujoco><option><flag sleep="enable"/></option><worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/><body pos="0 0 .05"><freejoint/>
    <geom name="ball" size=".05"/></body></worldbody></mujoco>"""
    scene = make_scene(model, "pairs: [{geoms: [floor, ball]}]\n")
    assert_same_bits(runs_of(scene, {"sleep": False}), monkeypatch)


def test_without_a_compiler_sensors_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CC", "")
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(CompilerError, match="no C compiler"):
        compiled_kernel()
    assert_same_bits(runs_of(Scene.open("ball_drop"), {}), monkeypatch, read=False)
    assert [*(tmp_path / "contactlab").iterdir()] == []


def test_a_sweep_says_once_that_sensors_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CC", "")
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    case = resources.SWEEPS / "stability" / "free_fall.yaml"
    said: list[int] = []
    for way, name in (("", "kernel"), ("", "kernel"), ("off", "sensors")):
        monkeypatch.setenv(SWITCH, way)
        ask = replace(request(case, tmp_path / name, *SHORT, "duration=0.01"), workers=1)
        run_sweep(ask, lambda *_: None, lambda _finished: None)
        said.append(caplog.text.count("install cc, or pip install 'ziglang>="))
    # The second has nothing left to run; in the third they were asked for.
    assert said == [1, 1, 1]


def test_a_compiler_that_fails_is_left_aside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("CC", "/bin/false --never")
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    with pytest.raises(CompilerError, match="/bin/false"):
        compiled_kernel()
    assert "/bin/false" in str(contact_kernel.load_kernel())


def test_a_cache_that_others_may_write_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "contactlab").mkdir()
    (tmp_path / "contactlab").chmod(0o777)
    with pytest.raises(CompilerError, match="others may write"):
        compiled_kernel()


@pytest.mark.long
@pytest.mark.usefixtures("kernel")
def test_processes_may_compile_it_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with get_context("fork").Pool(3) as pool:
        files = set(pool.map(_compiled, range(3), 1))
    assert [*(tmp_path / "contactlab").iterdir()] == [*files]


def _compiled(_: int) -> Path:
    return compiled_kernel()


@pytest.mark.parametrize("planted", ["forces", "counts"])
def test_one_that_disagrees_with_sensors_is_given_up(
    planted: str, kernel: contact_kernel.Kernel, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = contact_kernel.roll_out

    def wrong(*arguments: Any, **options: Any) -> Rollout:
        rollout = true(*arguments, **options)
        if options and planted == "counts":
            rollout.sensors[:, :, 0] += 1
        return rollout

    if planted == "forces":
        slots = contact_kernel.recorded_slots
        monkeypatch.setattr(
            contact_kernel,
            "recorded_slots",
            lambda *given: tuple(2 * each for each in slots(*given)),
        )
    monkeypatch.setattr(contact_kernel, "roll_out", wrong)
    runs = runs_of(Scene.open("ball_drop"), {}, {})
    with pytest.warns(UserWarning, match="sensors from now on") as said:
        assert_same_bits(runs, monkeypatch, read=False)
    assert_same_bits(runs, monkeypatch, read=False)
    assert len(said) == 1
    assert kernel.failed


def request(sweep: Path, store: Path, *overrides: str) -> SweepRequest:
    """Return what runs a sweep in this process, and keeps all traces."""
    given = Overrides(("trace=all", *overrides))
    return read_request(sweep, sweep.stem, store, folder=sweep.parent, workers=0, overrides=given)


def stored(sweep: Path, store: Path, workers: int) -> dict[str, bytes]:
    """Run a sweep by so many processes, or in this one, and return its traces."""
    ask = request(sweep, store)
    if not AS_WRITTEN:
        seconds = min(MOST_SECONDS, ask.scene.duration)
        ask = request(sweep, store, *SHORT, f"duration={seconds}")
    ask = replace(ask, workers=workers)
    run_sweep(ask, lambda *_: None, lambda _finished: None)
    return {path.relative_to(store).as_posix(): path.read_bytes() for path in store.rglob("*.mcap")}


def assert_same_stores(case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare every trace: all arrays, and the record but for costs and times of day."""
    # Records name the commit of the folder that a sweep is run from, which may move in between.
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(SWITCH, "off")
    by_sensors = stored(case, tmp_path / "sensors", 0)
    assert by_sensors
    monkeypatch.setenv(SWITCH, "on")
    for workers in range(5 if AS_WRITTEN else 1):
        assert stored(case, tmp_path / f"{workers}", workers) == by_sensors, f"{workers} workers"


# Slides, balls that roll, what is pinched, and what only springs and joints hold.
QUICK = [
    each for each in CATALOGUE if each.stem in {"scales", "gripping_pad", "ladder", "isotropy"}
]


@pytest.mark.long
@pytest.mark.parametrize("case", QUICK, ids=lambda case: case.stem)
def test_a_case_is_stored_alike(
    case: Path, kernel: contact_kernel.Kernel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert_same_stores(case, tmp_path, monkeypatch)
    assert not kernel.failed


@pytest.mark.night
@pytest.mark.parametrize("case", CATALOGUE, ids=lambda case: case.stem)
def test_every_case_is_stored_alike(
    case: Path, kernel: contact_kernel.Kernel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert_same_stores(case, tmp_path, monkeypatch)
    assert not kernel.failed


@pytest.mark.night
@pytest.mark.usefixtures("kernel")
def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    """The tests of this file again, with a kernel that stops at whatever C leaves undefined."""
    chosen = "a_case_is or random_models or those_of_sensors or both_sides or stop_or_fail"
    run_sanitized(__file__, f"({chosen}) and not many", tmp_path)
