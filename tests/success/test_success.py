"""Which successes are physical: exploits lose them, honest policies keep them."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from tests.success import episodes_of_exploits as exploits

import contactlab
from contactlab.errors import SceneError, SweepFileError
from contactlab.run.sweep_request import read_request
from contactlab.run.sweep_runner import run_sweep
from contactlab.schema.success import SuccessReport
from contactlab.shares import anytime_interval, runs_to_decide, wilson_interval
from contactlab.store.finished_store import Store
from contactlab.studies.success.decisive_contacts import Parts, choose_pairs
from contactlab.studies.success.episode_choice import EpisodesUntilDecided
from contactlab.studies.success.episode_table import Episode, EpisodeTable
from contactlab.studies.success.success_request import read_requirement

FILE = Path(exploits.__file__)


def judged(folder: Path, env: str, policy: str, **options: Any) -> SuccessReport:
    drive = f"{FILE}:{policy}"
    given: dict[str, Any] = {
        "episodes": 3,
        "allow_code": True,
        "workers": 0,
        "output": folder,
        **options,
    }
    return contactlab.success(f"{FILE}:{env}", drive=drive, **given)


def played(env: exploits.Task, policy: Any, seed: int, rate: int = 1) -> np.ndarray:
    """Play an episode by an obvious loop, and return its last state."""
    control, model, data = env.model.opt.timestep, env.model, env.data
    seen, _ = env.reset(seed=seed)
    for _ in range(env.count):
        data.ctrl[:] = policy.act(seen)
        model.opt.timestep = control / rate
        for _ in range(env.skip * rate):
            mujoco.mj_step(model, data)
        seen = env.observe()
    return np.concatenate([data.qpos, data.qvel])


def final_state(store: Store, variant: str) -> np.ndarray:
    (record,) = (each for each in store.records() if each.axes["variant"] == variant)
    trace = store.trace(record)
    return np.concatenate([trace.qpos[-1], trace.qvel[-1]])


@pytest.mark.long
def test_a_variant_is_what_an_obvious_loop_plays(tmp_path: Path) -> None:
    """Finer steps keep the control rate; other variants change the model before the reset.

    An episode without a record ends as the recorded one does.
    """
    names = ["as written", "a quarter of the step", "other cone", "half the solref", "mass x 0.8"]
    sweep = {
        "version": 1,
        "scene": {"environment": f"{FILE}:FirmShelf"},
        "drive": {"policy": f"{FILE}:PushAside"},
        "axes": {"variant": names},
        "seeds": 1,
        "duration": 2.0,
    }
    ask = read_request(
        sweep, "variants", tmp_path / "store", folder=tmp_path, workers=0, allow_code=True
    )
    run_sweep(replace(ask, allow_code=True), lambda *_: None, lambda *_: None)
    store = Store.open(tmp_path / "store")
    report = judged(tmp_path / "study", "FirmShelf", "PushAside", episodes=1, variant=names[1:])
    unrecorded = json.loads((tmp_path / "study" / "outcomes.json").read_text(encoding="utf-8"))
    ends = {each["axes"]["variant"]: each for each in unrecorded}

    assert report.written.good == 1
    for name in names:
        env = exploits.FirmShelf()
        match name:
            case "other cone":
                env.model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
            case "half the solref":
                env.model.geom_solref[:, 0] /= 2
            case "mass x 0.8":
                env.model.body_mass *= 0.8
                env.model.body_inertia *= 0.8
                mujoco.mj_setConst(env.model, mujoco.MjData(env.model))
            case _:
                pass
        rate = 4 if name.startswith("a quarter") else 1
        state = played(env, exploits.PushAside(env.model), 0, rate)
        assert np.array_equal(final_state(store, name), state), name
        (record,) = (each for each in store.records() if each.axes["variant"] == name)
        if name != "as written":
            for field in ("status", "success", "total_reward", "steps", "status_reason"):
                assert ends[name][field] == getattr(record, field), (name, field)


@pytest.mark.long
@pytest.mark.parametrize(
    ("env", "policy", "cause", "variant"),
    [
        ("Shelf", "PressThrough", "tunneling", "half the solref"),
        ("Carry", "Hover", "contact_at_distance", "no margins"),
        ("Throw", "Hold", "half the step", "half the step"),
    ],
)
def test_an_exploit_is_not_physical(
    tmp_path: Path, env: str, policy: str, cause: str, variant: str
) -> None:
    report = judged(tmp_path, env, policy, variant=[variant])

    assert (report.written.good, report.physical.good) == (3, 0)
    assert cause in {loss.cause for loss in report.losses}
    assert report.parting is not None
    assert report.parting.variant == variant
    assert "0 % physically" in report.describe().sections[0].blocks[0].text  # type: ignore[union-attr]


@pytest.mark.long
@pytest.mark.parametrize(
    ("env", "policy", "loses"),
    [
        ("ThickCreep", "Grasp", True),
        ("SoftTray", "Raise", True),
        ("PyramidGrip", "Grasp", False),
        ("FirmTray", "Raise", False),
        ("FirmGrip", "Shake", False),
    ],
)
def test_a_contact_that_is_lost_soon_is_not_physical(
    tmp_path: Path, env: str, policy: str, loses: bool
) -> None:
    """No variant shows it, since friction is as soft in all of them; four times the time does."""
    report = judged(tmp_path, env, policy, episodes=2, variant=["half the step"])
    task = getattr(exploits, env)()
    actor, (seen, _), lost = getattr(exploits, policy)(task.model), task.reset(seed=0), None
    for _ in range(4 * task.count):
        seen, *_ = task.step(actor.act(seen))
        if lost is None and task.made >= task.count and not task.succeeds():
            lost = task.made

    assert (lost is not None) == loses
    expected = [("creeping", 2)] if loses else []
    assert [(loss.cause, loss.alone) for loss in report.losses] == expected
    assert report.parting is None
    page = (tmp_path / "success.html").read_text(encoding="utf-8")
    assert loses == ("100 % succeed, 0 % physically" in page)
    assert not loses or "creeping at 0." in page or "No film here" in page


@pytest.mark.long
@pytest.mark.parametrize(
    ("env", "policy"),
    [
        ("FirmGrip", "Grasp"),
        ("FirmShelf", "PushAside"),
        ("HonestCarry", "Grasp"),
        ("HonestThrow", "Swing"),
    ],
)
def test_an_honest_policy_is_physical(tmp_path: Path, env: str, policy: str) -> None:
    report = judged(tmp_path, env, policy, episodes=2)

    assert report.written.good == report.physical.good == 2
    assert report.losses == ()
    assert report.parting is None


@pytest.mark.long
def test_recorded_episodes_are_judged_by_their_contacts(tmp_path: Path) -> None:
    """Without code no variant is played; the exploit is still seen, and the report says so."""
    model = exploits.Carry().model
    for env, policy, sound in (("Carry", "Hover", 0), ("HonestCarry", "Grasp", 1)):
        task = getattr(exploits, env)()
        model, data = task.model, task.data
        act = getattr(exploits, policy)(model).act
        with contactlab.record(model, data, tmp_path / env) as recording:
            seen, _ = task.reset(seed=0)
            for _ in range(task.count):
                data.ctrl[:] = act(seen)
                recording.step(task.skip)
                seen = task.observe()
            recording.reset(success=task.succeeds())

        report = contactlab.success(tmp_path / env, output=tmp_path / "report")

        assert (report.written.good, report.sound.good) == (1, sound)
        assert not report.repeated
        assert len(report.not_checked) == 2
        assert report.objects == ("box",)


@pytest.mark.long
def test_episodes_end_once_a_requirement_is_decided(tmp_path: Path) -> None:
    options = {"episodes": 60, "variant": ["half the step"], "require": ["physical >= 50 %"]}
    report = judged(tmp_path, "Throw", "Hold", **options)

    assert report.stop == "decided"
    assert report.written.episodes < 60
    assert report.requirements[0].outcome == "unmet"
    assert report.problem


class Planned:
    """A plan of cases by seed, each as written and under variants."""

    def __init__(self, cases: int, variants: Sequence[str]) -> None:
        self.cases, self.variants = cases, variants

    def iterate_runs(self) -> Iterator[Any]:
        for place, variant in enumerate(self.variants):
            for seed in range(self.cases):
                index = place * self.cases + seed
                yield SimpleNamespace(index=index, values={"variant": variant}, seed=seed)


def test_costly_variants_and_chance_are_played_if_they_matter() -> None:
    """A quarter of the step is played in 10 cases, or in all of them once it changes an outcome.

    Variants are played without a record, except for the first success that each takes away.
    """
    variants = ["as written", "half the step", "a quarter of the step", "nudged"]
    for changing, quarters, nudged in (
        ((), 10, 0),
        (("half the step",), 10, 50),
        ((variants[2],), 50, 50),
    ):
        ids = np.arange(4 * 50, dtype=np.uint64)

        def tabulate(finished: Any, changing: Any = changing) -> EpisodeTable:
            table = EpisodeTable(variants[1:3])
            for case, variant, row in finished:
                table.add_episode(case, variant, Episode(row["run_id"], variant not in changing))
            return table

        plan: Any = Planned(50, variants)
        chosen = EpisodesUntilDecided(plan, ids, tabulate, lambda _: False, "nudged", [variants[2]])
        counts = np.zeros(4, int)
        while (wanted := chosen.next_runs()).any():
            ids = [f"{place:016x}" for place in np.flatnonzero(wanted).tolist()]
            if chosen.purpose == "record":
                chosen.add_rows({"run_id": run_id} for run_id in ids)
            else:
                counts += np.bincount([int(run_id, 16) // 50 for run_id in ids], minlength=4)
                chosen.learn_notes({run_id: {"status": "ok", "steps": 1} for run_id in ids})
        recorded = np.bincount([place // 50 for place in map(int, chosen.known)], minlength=4)

        assert counts.tolist() == [0, 50, quarters, nudged]
        assert recorded.tolist() == [50, *(int(name in changing) for name in variants[1:])]
        assert sum(1 for _ in chosen.iterate_unrecorded()) == counts.sum() - len(changing)


def test_objects_are_the_things_that_no_actuator_moves() -> None:
    model = exploits.HonestCarry().model
    parts = Parts.from_model(model)

    assert {model.body(body).name for body in parts.things} == {"box"}
    assert {model.body(body).name for body in parts.agents} == {"hand", "left", "right"}
    pairs = {frozenset(each.geoms or ()) for each in choose_pairs(model, [])}
    assert pairs == {frozenset(("box", other)) for other in ("floor", "left", "right")}
    with pytest.raises(SceneError, match="--object mug: no such body"):
        choose_pairs(model, ["mug"])


@pytest.mark.parametrize(
    ("text", "read"),
    [("physical >= 80 %", ("physical", 0.8)), ("success>=0.9", ("success", 0.9))],
)
def test_requirements_are_shares(text: str, read: tuple[str, float]) -> None:
    assert read_requirement(text) == read


@pytest.mark.parametrize("text", ["physical > 80 %", "real >= 80 %", "physical >= 180 %"])
def test_a_wrong_requirement_says_what_to_write(text: str) -> None:
    with pytest.raises(SweepFileError, match="--require"):
        read_requirement(text)


def test_the_number_that_decides_is_where_wilsons_interval_leaves_the_limit() -> None:
    """The formula inverts the score test; rounding of counts moves it by a few runs."""
    for share, limit in ((0.9, 0.8), (0.6, 0.8), (1.0, 0.95)):
        runs = runs_to_decide(share, limit)
        assert runs is not None
        around = [
            wilson_interval(round(share * n), n) for n in (int(runs * 0.8), int(runs * 1.2) + 1)
        ]
        inside = [low < limit <= high for low, high in around]
        assert inside == [True, False]


@pytest.mark.long
def test_a_sequential_stop_errs_in_at_most_one_of_twenty() -> None:
    """Ville's inequality: 1,000 tries that look after each of 200 episodes."""
    rng = np.random.default_rng(0)
    for share in (0.5, 0.8, 0.95):
        counts = np.cumsum(rng.random((1000, 200)) < share, axis=1)
        ends = {(k, n): anytime_interval(k, n) for n in range(10, 201, 10) for k in range(n + 1)}
        wrong = [
            any(
                not low <= share <= high
                for n in range(10, 201, 10)
                for low, high in [ends[int(row[n - 1]), n]]
            )
            for row in counts
        ]
        assert np.mean(wrong) <= 0.05
