"""Sweeps over environments: an episode is a run of the swept model, and what is refused."""

import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests import push_env
from tests.push_env import PUSHED, SKIP

import contactlab
from contactlab.errors import ContactlabError, SceneError, SweepFileError
from contactlab.loop.simulation import read_success, reset_with_seed
from contactlab.measure import METRICS
from contactlab.run.recomputed_runs import simulate_again
from contactlab.run.stored_runs import replay_run
from contactlab.schema.evidence import EvidenceRecord
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

FILE = Path(push_env.__file__)
AXES = {"timestep": [1e-3, 2e-3], "friction.slide": [0.2, 1.0], "body_mass[puck]": [1.0, 2.0]}
CASES = {
    "plain": {},
    "numerics": {"integrator": ["RK4"], "cone": ["elliptic"], "timestep": [1e-3]},
    "contacts": {"solref": ["0.01 1"], "friction.slide": [0.4], "margin": [1e-3]},
    "fields": {"body_mass[puck]": [2.5], "dof_damping[x]": [0.3], "gravity": ["0 0 -5"]},
}


def _sweep(
    folder: Path, name: str = "Push", *, allow_code: bool = True, workers: int = 0, **keys: Any
) -> Store:
    """Return the store of a sweep over an environment of the file beside."""
    shutil.copy(FILE, folder)
    scene = {"environment": f"{folder / FILE.name}:{name}"}
    sweep = {"version": 1, "scene": scene, "duration": 0.1, **keys}
    return contactlab.sweep(
        sweep, output=folder / "store", workers=workers, allow_code=allow_code, fresh=True
    )


def _first(store: Store) -> EvidenceRecord:
    return next(iter(store.records()))


@pytest.mark.long
def test_an_episode_is_a_run_of_each_value(tmp_path: Path) -> None:
    store = _sweep(tmp_path, axes=AXES, seeds=2)

    records = list(store.records())
    assert len(records) == 16
    assert {each.engine.name for each in records} == {"loop"}
    for each in records:
        assert each.settings["timestep"] == each.axes["timestep"]
        assert each.pairs["floor-puck"].friction[0] == each.axes["friction.slide"]
        assert each.loop is not None
        assert each.loop.changed == each.loop.changed_under_way == ()
        assert each.steps % SKIP == 0
        assert each.total_reward is not None
    # What is drawn by the seed alone moves heavier pucks less, and all things alike twice.
    travels = {
        (each.seed, each.axes["body_mass[puck]"]): np.ptp(store.trace(each).qpos[:, 0])
        for each in records
        if each.axes["timestep"] == 2e-3 and each.axes["friction.slide"] == 0.2
    }
    assert all(travels[seed, 1.0] > travels[seed, 2.0] for seed in (0, 1))
    assert "cost" in store.manifest.sweep.lacking
    assert not find_problems(tmp_path / "store")


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_an_episode_has_the_bits_of_a_sweep_with_its_controls(tmp_path: Path, case: str) -> None:
    axes: Mapping[str, Any] = CASES[case]
    mine = _sweep(tmp_path, axes=axes, seeds=[3])
    episode = _first(mine)
    (tmp_path / "model.xml").write_text(PUSHED, encoding="utf-8")
    timestep = float(str(episode.settings["timestep"]))
    rng = np.random.default_rng(3)
    held = np.repeat([rng.uniform(-30, 30) for _ in range(episode.steps // SKIP)], SKIP)
    rows: dict[str, Any] = {
        "time": np.arange(episode.steps + 1) * timestep,
        "push": np.append(held, held[-1]),
    }
    np.savez(tmp_path / "drive.npz", **rows)
    plain = contactlab.sweep(
        {
            "version": 1,
            "scene": str(tmp_path / "model.xml"),
            "duration": episode.steps * timestep,
            "drive": {"file": str(tmp_path / "drive.npz"), "interpolation": "hold"},
            "axes": {**axes, "perturbation": [0.0]},
            "effects": {"base": "all"},
            "checks": "none",
        },
        output=tmp_path / "plain",
        workers=0,
    )
    run = _first(plain)

    assert episode.trajectory_hash == run.trajectory_hash
    names = [name for name, each in METRICS.items() if each.kind != "check"]
    assert [episode.metrics[name] for name in names] == [run.metrics[name] for name in names]
    assert any(run.metrics[name] for name in names)
    assert (episode.labels, episode.pairs) == (run.labels, run.pairs)


@pytest.mark.long
def test_workers_order_and_resume_change_nothing(tmp_path: Path) -> None:
    store = _sweep(tmp_path, axes=AXES, seeds=2)
    hashes = {each.run_id: each.trajectory_hash for each in store.records()}

    again = _sweep(tmp_path, axes={**AXES, "timestep": [2e-3, 1e-3]}, seeds=[1, 0], workers=2)

    assert {each.run_id: each.trajectory_hash for each in again.records()} == hashes


@pytest.mark.long
def test_an_environment_says_when_its_episode_ends(tmp_path: Path) -> None:
    policy = {"policy": f"{tmp_path / FILE.name}:Seeing"}
    store = _sweep(tmp_path, drive=policy, duration=2.0, axes={"gravity": ["0 0 0"]})

    record = _first(store)
    assert record.success
    assert record.status == "ok"
    assert record.steps == record.steps_asked < 1000
    assert record.duration == 2.0
    controls = store.controls(record)
    assert controls is not None
    assert len(controls.levels) == record.steps / SKIP + 1

    record = _first(_sweep(tmp_path, drive={**policy, "rate": 100}))
    assert record.status == "error"
    assert "acts in each step of the environment" in str(record.status_reason)


@pytest.mark.long
def test_a_policy_acts_at_its_rate(tmp_path: Path) -> None:
    shutil.copy(FILE, tmp_path)
    drive = {"policy": f"{tmp_path / FILE.name}:Constant"}
    store = _sweep(tmp_path, drive=drive, axes={"drive.rate": [50, 100]})

    slow, fast = store.records()
    for record, calls in ((slow, 5), (fast, 10)):
        controls = store.controls(record)
        assert controls is not None
        assert len(controls.levels) == calls + 1
    record = _first(_sweep(tmp_path, drive={**drive, "rate": 400}))
    assert record.status == "error"
    assert "at 400 Hz, but the environment asks for actions at 100 Hz" in str(record.status_reason)


@pytest.mark.long
def test_what_the_environment_changes_is_recorded_and_its_own(tmp_path: Path) -> None:
    for record in _sweep(tmp_path, "Varied", axes={"friction.slide": [0.5]}, seeds=2).records():
        assert record.loop is not None
        assert record.loop.changed == ("dof_damping", "geom_pos")
        assert record.loop.changed_under_way == ("dof_damping",)
    damped = {each.trajectory_hash for each in contactlab.open(tmp_path / "store").records()}
    again = _sweep(tmp_path, "Varied", axes={"friction.slide": [0.5]}, seeds=[1, 0]).records()
    assert {each.trajectory_hash for each in again} == damped


@pytest.mark.long
def test_a_model_made_anew_is_written_too(tmp_path: Path) -> None:
    axes = {"friction.slide": [0.2, 1.0], "timestep": [1e-3]}
    anew = [each.trajectory_hash for each in _sweep(tmp_path, "Anew", axes=axes).records()]
    kept = [each.trajectory_hash for each in _sweep(tmp_path, axes=axes).records()]
    assert anew == kept


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "reason", "steps"),
    [
        (
            "Stubborn",
            r"reset\(\) of the environment overwrites values of the sweep: geom_friction",
            0,
        ),
        ("Failing", r"environment: line \d+ of push_env.py: ValueError: out of ideas", 2 * SKIP),
        ("Unheard", "made no step by mujoco.mj_step", 0),
        ("Looping", "cut: the environment was reset within a step", 3 * SKIP),
        ("Unrewarded", r"step\(\) of the environment returned the reward nan", SKIP),
        ("Unplaced", "qpos is not finite at the start of an episode", 0),
        ("Rough", "geom_solimp is not finite at the start of an episode", 0),
        ("Other", "the model differs from that of the sweep in .*names", 0),
        ("Slowing", r"step\(\) of the environment changes opt.timestep", SKIP),
        ("Closed", r"no action_space with seed\(\) and sample\(\)", 0),
    ],
)
def test_what_fails_costs_its_own_run(tmp_path: Path, name: str, reason: str, steps: int) -> None:
    store = _sweep(tmp_path, name, axes={"friction.slide": [0.9]}, seeds=[1])

    record = _first(store)
    assert record.status == ("stopped" if name == "Looping" else "error")
    assert record.label == ("invalid" if record.status == "error" else record.label)
    assert re.search(reason, str(record.status_reason))
    assert record.steps == steps
    assert not find_problems(tmp_path / "store")


def test_a_policy_that_returns_no_number_ends_its_run(tmp_path: Path) -> None:
    record = _first(_sweep(tmp_path, drive={"policy": f"{tmp_path / FILE.name}:Wild"}))
    assert record.status == "error"
    assert "the policy returned [[nan]] at 0.06 s" in str(record.status_reason)
    assert record.steps == 0.06 / 0.002


@pytest.mark.long
def test_others_are_run_where_one_fails(tmp_path: Path) -> None:
    failing = _sweep(tmp_path, "Failing", seeds=4, axes={"gravity": ["0 0 -5"]})
    kept = {each.seed: each.trajectory_hash for each in failing.records() if each.status == "ok"}
    whole = _sweep(tmp_path, "Push", seeds=4, axes={"gravity": ["0 0 -5"]})
    assert kept == {
        each.seed: each.trajectory_hash for each in whole.records() if not each.seed % 2
    }


@pytest.mark.long
def test_code_runs_only_if_it_is_allowed(tmp_path: Path) -> None:
    with pytest.raises(SweepFileError, match=r"environment .* is Python code, .*--allow-code"):
        _sweep(tmp_path, allow_code=False)
    assert not (tmp_path / "store").exists()

    store = _sweep(tmp_path, axes={"timestep": [1e-3, 2e-3]})
    run = _first(store).run_id
    with pytest.raises(SceneError, match=rf"run {run} is an episode of .*--allow-code"):
        replay_run(store, run)
    with pytest.raises(SceneError, match="is an episode"):
        simulate_again(store, 1)
    (tmp_path / FILE.name).unlink()  # The store has its own.
    assert replay_run(store, run, allow_code=True).equal
    assert simulate_again(store, 2, allow_code=True).problems == []


def test_a_replay_finds_what_a_seed_does_not_decide(tmp_path: Path) -> None:
    store = _sweep(tmp_path, "Unseeded")
    assert not replay_run(store, _first(store).run_id, allow_code=True).equal


@pytest.mark.parametrize(
    ("name", "keys", "reason"),
    [
        ("Missing", {}, "it has no class Missing; write one of .*Push"),
        ("broken", {}, r"line \d+ of push_env.py: RuntimeError: no robot here"),
        ("NoModel", {}, "push_env.py:NoModel: NoModel has no MuJoCo model and data"),
        ("nothing", {}, "push_env.py:nothing: NoneType has no MuJoCo model and data"),
        ("Push", {"drive": "hold"}, "an environment takes actions of a policy, or of its own"),
        (
            "Push",
            {"axes": {"perturbation": [0.5]}},
            r"perturbation: reset\(seed=...\) sets the start of an environment",
        ),
        ("Push", {"axes": {"engine": ["mujoco"]}}, "engine"),
        ("Push", {"knife_edge": True}, "knife_edge needs steps of MuJoCo's own"),
        ("Push", {"accuracy": {}}, "accuracy needs steps of MuJoCo's own"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_runs(
    tmp_path: Path, name: str, keys: Mapping[str, Any], reason: str
) -> None:
    with pytest.raises(ContactlabError, match=reason):
        _sweep(tmp_path, name, **keys)
    assert not (tmp_path / "store/manifest.json").exists()


def test_an_unknown_file_or_id_is_said(tmp_path: Path) -> None:
    for name in ("nowhere.py:make", "NoSuchEnvironment-v0"):
        sweep = {"version": 1, "scene": {"environment": name}}
        said = "nowhere.py:make: no file " if ".py" in name else name
        with pytest.raises(ContactlabError, match=said):
            contactlab.sweep(sweep, output=tmp_path / "store", workers=0, allow_code=True)


@pytest.mark.parametrize(
    "scene",
    [
        {"environment": 3},
        {"environment": None},
        {"environment": ""},
        {"environment": "push_env.py"},
        {"environment": "push_env.py:"},
        {"environment": "push_env.py:Push", "pairs": []},
        {"enviroment": "push_env.py:Push"},
        {},
        ["push_env.py:Push"],
    ],
)
def test_a_scene_that_names_no_environment_is_told_how(tmp_path: Path, scene: object) -> None:
    sweep = {"version": 1, "scene": scene}
    with pytest.raises(SweepFileError, match=r"'scene' takes .*{environment: NAME}.*FILE.py:FACT"):
        contactlab.sweep(sweep, output=tmp_path / "store", workers=0, allow_code=True)


def test_other_commands_say_that_environments_are_swept(tmp_path: Path) -> None:
    (tmp_path / "push.yaml").write_text(
        f"version: 1\nscene: {{environment: '{FILE}:Push'}}\n", encoding="utf-8"
    )
    with pytest.raises(ContactlabError, match="other commands take models that MuJoCo"):
        contactlab.tradeoff(tmp_path / "push.yaml", allow_code=True, output=tmp_path / "out")


def test_a_manifest_says_what_is_asked_of_an_environment(tmp_path: Path) -> None:
    shutil.copy(FILE, tmp_path)
    (tmp_path / "scene.yaml").write_text(
        "version: 1\ntitle: Push\ndescription: A puck.\nenvironment: push_env.py:Push\n"
        "duration: 0.1\nsubject: puck\npairs: [{bodies: [world, puck]}]\n"
        "drive: {policy: push_env.py:Constant}\neffects: {warmstart: false}\n",
        encoding="utf-8",
    )
    sweep = {"version": 1, "scene": f"{tmp_path}/", "axes": {"mass": [1.0, 3.0]}}
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0, allow_code=True)
    light, heavy = store.records()
    assert list(light.pairs) == list(heavy.pairs) == ["world-puck"]
    assert not light.effects["warmstart"]
    assert light.settings["mass"] == 1.0
    assert heavy.settings["mass"] == 3.0
    assert light.trajectory_hash != heavy.trajectory_hash
    assert replay_run(store, heavy.run_id, allow_code=True).equal

    with (tmp_path / "scene.yaml").open("a", encoding="utf-8") as file:
        file.write("perturb: {coordinates: [x], scale: 0.1}\n")
    with pytest.raises(SweepFileError, match=r"perturb: the environment push_env.py:Push sets it"):
        contactlab.sweep(sweep, output=tmp_path / "other", workers=0, allow_code=True)


def test_an_environment_of_gymnasium(tmp_path: Path) -> None:
    gymnasium = pytest.importorskip("gymnasium")
    pytest.importorskip("imageio")
    axes = {"timestep": [5e-3, 1e-2]}
    sweep = {"version": 1, "scene": {"environment": "InvertedPendulum-v5"}, "axes": axes}
    store = contactlab.sweep(sweep, output=tmp_path / "store", workers=0, allow_code=True)
    short, long = store.records()
    # It ends when the pole leans too far, of 1000 steps of 0.04 s at most.
    assert short.duration == pytest.approx(
        gymnasium.make("InvertedPendulum-v5").spec.max_episode_steps * 0.04
    )
    assert 0 < short.steps < 4000
    assert short.total_reward == short.steps / 2 - 1
    assert (short.settings["timestep"], long.settings["timestep"]) == (5e-3, 1e-2)
    assert replay_run(store, long.run_id, allow_code=True).equal


def test_code_that_changed_under_way_is_not_run(tmp_path: Path) -> None:
    store = _sweep(tmp_path)
    copy = next(store.scene_folder.rglob(FILE.name))
    copy.write_text(copy.read_text(encoding="utf-8") + "# more", encoding="utf-8")
    with pytest.raises(ContactlabError, match="give another id"):
        replay_run(store, _first(store).run_id, allow_code=True)


@pytest.mark.parametrize("timestep", [1e-3, 2e-3])
def test_an_episode_lasts_as_long_as_the_run(tmp_path: Path, timestep: float) -> None:
    """An environment that goes on makes no step more than the run has, where its own divide it."""
    (record,) = _sweep(tmp_path, axes={"timestep": [timestep]}, checks="none").records()
    assert (record.status, record.steps) == ("ok", round(0.1 / timestep))


def test_robosuites_conventions() -> None:
    """Its environments draw from `rng`, take no seed, and answer `_check_success()`."""

    class Lift:
        rng = np.random.default_rng(7)

        def reset(self) -> float:
            return self.rng.uniform()

        def _check_success(self) -> np.bool_:
            return np.bool_(True)

    env = Lift()
    starts = [reset_with_seed(env, seed) for seed in (3, 4, 3)]
    assert starts == [np.random.default_rng(seed).uniform() for seed in (3, 4, 3)]
    assert read_success(env, {}) is True
    assert read_success(env, {"is_success": 0}) is False
    assert read_success(object(), {"TimeLimit.truncated": True}) is None
