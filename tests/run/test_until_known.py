"""A sampled sweep stops once its shares are known, and says how well they are."""

from pathlib import Path
from typing import Any

import pytest

import contactlab
from contactlab.errors import SweepFileError
from contactlab.reporting.chosen_runs import known_shares, share_lines
from contactlab.run.recomputed_runs import recomputed_problems
from contactlab.store.finished_store import Store
from contactlab.store.verify_store import find_problems

DRAWS = 400
WHOLE: dict[str, Any] = {
    "version": 1,
    "scene": "incline",
    "duration": 0.02,
    "axes": {"tilt": [10, 40], "friction.slide": {"uniform": [0.1, 1.0]}},
    "sample": {"method": "random", "n": DRAWS},
    "trace": "none",
    "checks": "none",
    "effects": "all",
}
# On 40 degrees some slide, by g sin(40) t^2 / 2 and less; on 10 degrees next to none.
UNTIL = {"share": "slip_distance > 0.5 mm", "half_width": "10%"}


def rows(store: Store) -> dict[str, Any]:
    names = ["run_id", "index", "trajectory_hash"]
    return {row["run_id"]: row for row in store.columns.read_arrow(names).to_pylist()}


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Store:
    folder = tmp_path_factory.mktemp("until")
    return contactlab.sweep({**WHOLE, "until": UNTIL}, output=folder / "store", workers=0)


@pytest.mark.long
def test_each_configuration_stops_when_its_share_is_known(stopped: Store) -> None:
    known = known_shares(stopped)
    assert known is not None
    until, shares = known
    assert len(shares) == 2
    assert sum(share.runs for share in shares) == stopped.manifest.runs < 2 * DRAWS
    for share in shares:
        assert (share.high - share.low) / 2 <= until.half_width
        assert share.low <= share.good / share.runs <= share.high
    # What is never met is known sooner.
    steep = max(shares, key=lambda share: dict(share.configuration)["tilt"])  # type: ignore[arg-type, return-value]
    assert steep.runs == max(share.runs for share in shares)
    assert "at any number of draws" in next(share_lines(until, shares))
    assert not [*find_problems(stopped.address)]
    assert not [*recomputed_problems(stopped)]


@pytest.mark.long
def test_its_runs_are_the_first_of_all_and_the_rest_can_be_added(
    stopped: Store, tmp_path: Path
) -> None:
    whole = contactlab.sweep(WHOLE, output=tmp_path / "store", workers=0)
    assert rows(stopped).items() < rows(whole).items()
    again = contactlab.sweep({**WHOLE, "until": UNTIL}, output=tmp_path / "two", workers=0)
    assert rows(again) == rows(stopped)
    filled = contactlab.sweep(WHOLE, output=tmp_path / "two", workers=0)
    assert rows(filled) == rows(whole)


@pytest.mark.parametrize(
    ("changes", "code", "remedy"),
    [
        ({"sample": {"method": "sobol", "n": 8}}, "until-method", "method: random"),
        ({"seeds": 2}, "until-seeds", "seeds: 1"),
        ({"axes": {"tilt": [10]}, "sample": None}, "until-no-draws", "seeds: 1000"),
        ({"until": {"share": "fell", "half_width": 0.1}}, "unknown-metric", "list metrics"),
        ({"until": {"share": "failed", "half_width": 0.7}}, "out-of-range", "half_width"),
        ({"until": {"share": "failed", "half_width": 0}}, "out-of-range", "half_width"),
        ({"refine": {"axes": ["tilt"], "to": 3}}, "two-choices", "leave one"),
    ],
)
def test_mistakes_name_the_remedy(
    changes: dict[str, Any], code: str, remedy: str, tmp_path: Path
) -> None:
    with pytest.raises(SweepFileError) as caught:
        contactlab.sweep({**WHOLE, "until": UNTIL, **changes}, output=tmp_path / "s", workers=0)
    assert code in str(caught.value)
    assert remedy in str(caught.value)
