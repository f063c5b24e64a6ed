"""`contactlab sweep`: what it prints, what it writes, and what it ends in."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest

Run = Callable[..., Any]


def test_a_sweep_of_a_file(contactlab: Run, small: Path, tmp_path: Path) -> None:
    code, out, err = contactlab("sweep", small.name, "--workers", "0")
    assert (code, err) == (0, "")
    assert "2 of 2 runs are as expected" in out
    assert "4 runs, 4 traces in results/small" in out
    assert (tmp_path / "results/small/manifest.json").is_file()
    again = contactlab("sweep", small.name, "--workers", "0")
    assert again == (0, out, "4 of 4 runs are stored already\n")


def test_a_shipped_sweep(contactlab: Run) -> None:
    code, out, _ = contactlab("sweep", "bounce", "--limit", "2", "--workers", "0")
    assert code == 0
    assert "2 runs, 2 traces in results/bounce" in out


def test_options_change_the_sweep(contactlab: Run, small: Path) -> None:
    options = ("--set", "timestep=1e-3,5e-3", "--set", "seeds=3", "--where", "drop_height=0.1")
    code, out, err = contactlab("sweep", small.name, "--workers", "0", "--format", "json", *options)
    assert code == 0, err
    assert json.loads(out)["runs"] == 6
    code, _, err = contactlab("sweep", small.name, "--workers", "0")
    assert code == 3
    assert "holds another sweep (other seeds, axes: seeds is [0,1,2] there and [0] here; " in err
    assert contactlab("sweep", small.name, "--workers", "0", "--fresh")[0] == 0


def test_a_plan_runs_nothing_and_writes_nothing(
    contactlab: Run, small: Path, tmp_path: Path
) -> None:
    code, out, err = contactlab("sweep", small.name, "--plan")
    assert (code, err) == (0, "")
    facts = dict(line.split(maxsplit=1) for line in out.splitlines()[:5])
    assert (facts["runs"], facts["steps"]) == ("4 (seeds 1)", "330")
    assert [path.name for path in tmp_path.iterdir()] == [small.name]
    plan = json.loads(contactlab("sweep", small.name, "--plan", "--format", "json")[1])
    assert (plan["runs"], plan["steps"], plan["seeds"]) == (4, 330, 1)
    assert [axis["name"] for axis in plan["axes"]] == ["timestep", "drop_height"]
    assert 0 < plan["seconds"][0] < plan["seconds"][1]
    assert 0 < plan["bytes"][0] < plan["bytes"][1]


def test_many_runs_need_a_yes(contactlab: Run, small: Path, tmp_path: Path) -> None:
    code, out, err = contactlab("sweep", small.name, "--set", "seeds=25001")
    assert (code, out) == (2, "")
    assert err == (
        "error: the sweep has 100,004 runs; look at it with --plan, then run it with --yes\n"
    )
    assert [path.name for path in tmp_path.iterdir()] == [small.name]
    limited = ("--set", "seeds=25001", "--limit", "1", "--workers", "0")
    assert contactlab("sweep", small.name, *limited)[0] == 0


def test_what_was_not_expected(contactlab: Run, small: Path) -> None:
    small.write_text(small.read_text().replace("{max: 1}", "{max: 1.0e-9}"))
    code, out, err = contactlab("sweep", small.name, "--workers", "0")
    assert (code, err) == (1, "error: 2 of 4 runs are not as the sweep expects\n")
    assert "0 of 2 runs are as expected" in out
    assert contactlab("sweep", small.name, "--workers", "0")[0] == 1


MISTAKES = [
    (["sweep", "bonce"], "error: no sweep file and no shipped sweep named 'bonce'; did you mean"),
    (["sweep", "nowhere.yaml"], "error: no sweep file nowhere.yaml"),
    (["sweep", "."], "error: no sweep file"),
    (["sweep", "small.yaml", "--set", "timestp=1"], "error[unknown-axis]: unknown axis 'timestp'"),
    (["sweep", "small.yaml", "--set", "timestep=0"], "error[bad-value]: 0 is not a value of 'time"),
    (
        ["sweep", "small.yaml", "--set", "timestep=nan"],
        "error[not-finite]: 'timestep' must be",
    ),
    (["sweep", "small.yaml", "--set", "timestep"], "error["),
    (
        ["sweep", "small.yaml", "--where", "timestep=7"],
        "error[value-not-swept]: 'timestep' never",
    ),
    (["sweep", "small.yaml", "--set", "scene=bal"], "error[unknown-scene]: no shipped scene named"),
    (["sweep", "small.yaml", "--set", "duration=100000000"], "error: a run of 50,000,000,000 st"),
    (["sweep", "small.yaml", "-o", "small.yaml"], "error: cannot write small.yaml: File exists"),
    (["sweep", "small.yaml", "-o", "."], "error: . holds other files (small.yaml)"),
]


@pytest.mark.parametrize(("arguments", "message"), MISTAKES, ids=lambda each: str(each)[:40])
def test_mistakes(
    contactlab: Run, small: Path, tmp_path: Path, arguments: list[str], message: str
) -> None:
    code, out, err = contactlab(*arguments, "--workers", "0")
    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert "Traceback" not in err
    assert not list(tmp_path.rglob("manifest.json"))
    assert small.is_file()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "error["),
        ("version: 1\nscene: [", "error["),
        ("version: 2\nscene: ball_drop\n", "error["),
        ("version: 1\nscene: ball_drop\naxes: {tiemstep: [1]}\n", "error[unknown-axis]"),
        ("\x00\xff", "error"),
    ],
)
def test_broken_sweep_files(contactlab: Run, tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "broken.yaml").write_bytes(text.encode("latin-1"))
    code, out, err = contactlab("sweep", "broken.yaml", "--workers", "0")
    assert (code, out) == (2, "")
    assert err.startswith(message)
    assert "Traceback" not in err
    assert [path.name for path in tmp_path.iterdir()] == ["broken.yaml"]


def test_expectations_that_are_not_met_are_for_jobs(
    contactlab: Run, small: Path, tmp_path: Path
) -> None:
    """Each format names the same two runs of which the other outcome was expected."""
    file = tmp_path / "wrong.yaml"
    file.write_text(small.read_text().replace("max: 1}", "max: 1.0e-9}"))
    code, out, err = contactlab("sweep", file.name, "--workers", "0", "--format", "junit")
    assert (code, err) == (1, "error: 2 of 4 runs are not as the sweep expects\n")
    cases = {case.get("name"): [*case] for case in ET.fromstring(out).iter("testcase")}  # noqa: S314
    assert [len(children) for children in cases.values()] == [0, 1]
    said = cases["runs as expected"][0].text or ""
    unmet = said.splitlines()[1:3]
    assert said.startswith("unmet: 0 of 2 runs are as expected; 2 have no expectation\n")
    assert all("penetration_max" in line and "timestep=0.002" in line for line in unmet)
    again = ("sweep", file.name, "--workers", "0", "--format")
    annotation = contactlab(*again, "github").out
    assert annotation.startswith("::error title=contactlab sweep wrong::runs as expected: 0 of 2")
    assert all(line.replace("%", "%25") in annotation for line in unmet)
    assert contactlab(*again, "markdown").out.startswith("### ❌ wrong: ")
