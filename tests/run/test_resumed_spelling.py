"""A sweep resumes whatever its files look like, as long as they mean the same runs."""

from collections.abc import Callable, Mapping
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from contactlab.errors import StoreError
from contactlab.run.recomputed_runs import recomputed_problems
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

MODEL = """<mujoco><option timestep="0.002"/><worldbody>
<geom name="floor" type="plane" size="1 1 .1"/>
<body name="box" pos="0 0 .1"><freejoint/><geom name="b" type="box" size=".05 .05 .05"/></body>
</worldbody></mujoco>
"""
SWEEP = """
version: 1
scene: box.xml
duration: 0.05
seeds: 2
checks: none
axes:
  timestep: [1e-3, 2e-3, 3e-3]
  friction.slide: [0.3, 1.0]
exclude:
  - {where: "timestep > 0.002", friction.slide: 1}
"""
RUNS = 10
Edit = Callable[[str], str]


def replaced(*pairs: str) -> Edit:
    def edit(text: str) -> str:
        for before, after in zip(pairs[::2], pairs[1::2], strict=True):
            assert before in text
            text = text.replace(before, after)
        return text

    return edit


def unchanged(text: str) -> str:
    return text


def stop(_: object) -> None:
    raise KeyboardInterrupt


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, make_sweeper: Any) -> Path:
    """A folder with the model, a finished store and a begun one."""
    folder = tmp_path_factory.mktemp("stored")
    (folder / "box.xml").write_text(MODEL)
    with pytest.MonkeyPatch.context() as patched:
        # Outside of a repository, whose commit records name.
        patched.chdir(folder)
        make_sweeper(folder).run(SWEEP, "finished")
        with pytest.raises(KeyboardInterrupt):
            make_sweeper(folder).run(SWEEP, "begun", progress=stop)
    return folder


@pytest.fixture
def resumed(stored: Path, tmp_path: Path, make_sweeper: Any) -> Any:
    """A sweeper in a copy of that folder."""
    copytree(stored, tmp_path / "copy")
    return make_sweeper(tmp_path / "copy")


SAME = {
    "a comment in the model": (replaced("<body", "<!-- the box --><body"), unchanged),
    "numbers of the model": (replaced('"1 1 .1"', '"1.0 1e0 0.10"', "0.002", "2e-3"), unchanged),
    "the order of attributes": (
        replaced('name="b" type="box"', 'type="box"   name="b"'),
        unchanged,
    ),
    "a list of seeds": (unchanged, replaced("seeds: 2", "seeds: [0, 1]")),
    "a linspace": (unchanged, replaced("[1e-3, 2e-3, 3e-3]", "{linspace: [1e-3, 3e-3, 3]}")),
    "a range": (unchanged, replaced("[1e-3, 2e-3, 3e-3]", "{range: [1 ms, 3 ms, 1 ms]}")),
    "a role that is the default": (unchanged, replaced("[0.3, 1.0]", "{values: [0.3, 1]}")),
    "an expression": (unchanged, replaced("timestep > 0.002", "timestep  >= 2.5e-3")),
    "both": (replaced("<body", "<!-- --><body"), replaced("seeds: 2", "seeds: [0, 1]")),
}


def both_stores(cases: Mapping[str, object], first: str) -> list[Any]:
    """Return each case with both stores; only one case is of the first tier."""
    return [
        pytest.param(name, case, marks=() if case == first else pytest.mark.long)
        for name in ("finished", "begun")
        for case in cases
    ]


@pytest.mark.parametrize(("name", "case"), both_stores(SAME, "both"))
def test_other_spellings_resume(resumed: Any, case: str, name: str) -> None:
    model, sweep = SAME[case]
    expected = resumed.outcome("finished")
    (resumed.folder / "box.xml").write_text(model(MODEL))
    resumed.run(sweep(SWEEP), name)
    (total, done) = resumed.began[0]
    assert 0 < done == (total if name == "finished" else done) <= total == RUNS
    assert resumed.outcome(name) == expected
    store = Store.open(resumed.folder / name)
    assert find_problems(store.address) == []
    assert [*recomputed_problems(store)] == []


OTHER = {
    "a size": (replaced('"1 1 .1"', '"1 2 .1"'), unchanged, r"box.xml has other .*geom_size"),
    "a name": (replaced('"b"', '"c"'), unchanged, "box.xml has other .*names"),
    "a seed": (unchanged, replaced("seeds: 2", "seeds: [0, 2]"), r"seeds is \[0,1\] there and"),
    "a value": (
        unchanged,
        replaced("3e-3]", "4e-3]"),
        r"axes.timestep is \[0.001,0.002,0.003\] there and \[0.001,0.002,0.004\] here\)",
    ),
    "a role": (
        unchanged,
        replaced("[0.3, 1.0]", "{values: [0.3, 1.0], role: scenario}"),
        "axes.friction.slide is",
    ),
    "the order": (unchanged, replaced("[0.3, 1.0]", "[1.0, 0.3]"), "axes.friction.slide is"),
    "a limit": (unchanged, replaced("0.002", "0.001"), "exclude is"),
    "a tolerance": (
        unchanged,
        replaced("seeds", "tolerances: {slip_distance: 1}\nseeds"),
        "tolerances",
    ),
}


@pytest.mark.parametrize(("name", "case"), both_stores(OTHER, "a size"))
def test_differences_are_named(resumed: Any, case: str, name: str) -> None:
    model, sweep, named = OTHER[case]
    (resumed.folder / "box.xml").write_text(model(MODEL))
    with pytest.raises(StoreError, match=f"{name} holds another sweep.*{named}"):
        resumed.run(sweep(SWEEP), name)
