"""Jobs on a cluster that loses them: each comes back once. The cluster is made up."""

from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("ray", reason="contactlab[ray] is not installed")

from ray.exceptions import (
    NodeDiedError,
    OutOfMemoryError,
    RaySystemError,
    TaskCancelledError,
    WorkerCrashedError,
)
from tests.run.bare_runs import bare_run

from contactlab.errors import ClusterError, OutputError
from contactlab.run.ray import executor as flight
from contactlab.run.ray import node
from contactlab.run.ray.executor import InFlight
from contactlab.run.tasks import MAX_LOSSES, CrashedJob, Job, Stop

GONE = [NodeDiedError("gone"), RaySystemError("gone"), WorkerCrashedError()]


def jobs(count: int) -> list[Job]:
    return [(bare_run(index, str(index)),) for index in range(count)]


class MadeUp:
    """A cluster that answers with what is given, job by job and attempt by attempt."""

    def __init__(self, answers: dict[str, list[Any]]) -> None:
        self.answers = answers
        self.sent: list[str] = []
        self.called_back: list[tuple[int, bool]] = []
        self.most = 0
        self._flying: set[int] = set()

    def send(self, job: Job) -> int:
        self.sent.append(job[0].run_id)
        self._flying.add(len(self.sent) - 1)
        self.most = max(self.most, len(self._flying))
        return len(self.sent) - 1

    def wait(
        self, references: list[int], num_returns: int = 1, timeout: float | None = None
    ) -> tuple[list[int], list[int]]:
        assert timeout
        return references[:num_returns], references[num_returns:]

    def get(self, reference: int) -> Any:
        self._flying.discard(reference)
        answers = self.answers.get(self.sent[reference], [])
        answer = answers.pop(0) if answers else [self.sent[reference]]
        if isinstance(answer, tuple):
            return answer[0]
        if isinstance(answer, Exception):
            raise answer
        return answer

    def cancel(self, reference: int, *, force: bool = False) -> None:
        self.called_back.append((reference, force))


Fly = Callable[..., tuple[MadeUp, Any, Stop]]


@pytest.fixture
def fly(monkeypatch: pytest.MonkeyPatch) -> Fly:
    """Send jobs to a made-up cluster; return it, the results to come, and what stops it."""

    def made(count: int, room: int = 4, **answers: list[Any]) -> tuple[MadeUp, Any, Stop]:
        cluster, stop = MadeUp({name[1:]: each for name, each in answers.items()}), Stop()
        monkeypatch.setattr(flight, "ray", cluster)
        results = InFlight(cluster.send, iter(jobs(count)), lambda: room, stop).iterate_results()
        return cluster, results, stop

    return made


@given(
    losses=st.lists(st.integers(0, MAX_LOSSES - 1), max_size=12),
    room=st.integers(1, 5),
    kind=st.sampled_from(GONE),
)
def test_jobs_whose_nodes_are_lost_come_back_once(
    losses: Sequence[int], room: int, kind: Exception
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        cluster = MadeUp({str(index): [kind] * lost for index, lost in enumerate(losses)})
        patch.setattr(flight, "ray", cluster)
        results = InFlight(
            cluster.send, iter(jobs(len(losses))), lambda: room, Stop()
        ).iterate_results()
        assert sorted(results, key=str) == sorted([[str(i)] for i in range(len(losses))], key=str)
    assert len(cluster.sent) == len(losses) + sum(losses)
    assert cluster.most <= room
    assert cluster.called_back == []


@pytest.mark.parametrize("kind", GONE)
def test_a_job_that_loses_every_node_is_lost(fly: Fly, kind: Exception) -> None:
    _, results, _ = fly(2, _1=[kind] * MAX_LOSSES)
    by_kind = {isinstance(each, CrashedJob): each for each in results}
    reason = f"its node was lost {MAX_LOSSES} times: {type(kind).__name__}"
    assert by_kind == {False: ["0"], True: CrashedJob(jobs(2)[1], reason, timed_out=False)}


def test_a_worker_without_memory_loses_its_job(fly: Fly) -> None:
    _, results, _ = fly(1, _0=[OutOfMemoryError("")])
    reason = "out of memory: the cluster ended the worker"
    assert list(results) == [CrashedJob(jobs(1)[0], reason, timed_out=False)]


def test_jobs_are_taken_as_there_is_room(fly: Fly) -> None:
    cluster, results, _ = fly(9, room=2)
    assert next(results) == ["0"]
    assert len(cluster.sent) == 2


def test_a_stop_calls_back_what_has_not_begun(fly: Fly) -> None:
    cluster, results, stop = fly(9, room=3, _2=[TaskCancelledError()])
    assert next(results) == ["0"]
    stop.request_stop()
    assert list(results) == [["1"]]
    assert cluster.sent == ["0", "1", "2"]
    assert (2, False) in cluster.called_back
    assert not any(force for _, force in cluster.called_back)


def test_who_leaves_early_ends_what_is_in_flight(fly: Fly) -> None:
    cluster, results, _ = fly(9, room=3)
    next(results)
    results.close()
    assert cluster.called_back == [(1, True), (2, True)]


@pytest.mark.parametrize(
    ("answer", "kind"),
    [("node far away has contactlab 0.0", ClusterError), (OutputError("no space"), OutputError)],
)
def test_a_refusal_and_a_failure_end_the_sweep(fly: Fly, answer: Any, kind: Any) -> None:
    # In a tuple, it is returned: an exception by itself is raised.
    cluster, results, _ = fly(9, room=3, _0=[(answer,)])
    with pytest.raises(kind, match=str(answer)):
        list(results)
    assert cluster.called_back == [(1, True), (2, True)]


@pytest.fixture
def terms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> node.NodeRequirements:
    """What a node must have, which this one has."""
    monkeypatch.setattr("ray.util.get_node_ip_address", lambda: "10.0.0.7")
    sign = tmp_path / "store/traces/1.tmp"
    sign.parent.mkdir(parents=True)
    sign.touch()
    return node.NodeRequirements("1", {"mujoco": version("mujoco")}, sign)


def test_a_node_that_has_all_is_fit(terms: node.NodeRequirements) -> None:
    assert node.refusal_reason(terms) is None


def other_version(terms: node.NodeRequirements) -> node.NodeRequirements:
    return node.NodeRequirements("1", {"mujoco": "1.0"}, terms.sentinel)


def not_installed(terms: node.NodeRequirements) -> node.NodeRequirements:
    return node.NodeRequirements(terms.token, {"contactlab-of-tomorrow": "1.0"})


def not_seen(terms: node.NodeRequirements) -> node.NodeRequirements:
    assert terms.sentinel is not None
    terms.sentinel.unlink()
    return terms


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (other_version, "but the sweep was started with mujoco 1.0; install the same versions"),
        (not_installed, "has no contactlab-of-tomorrow, but the sweep was started with"),
        (not_seen, "does not see the store "),
    ],
)
def test_a_node_that_lacks_something_says_so(
    terms: node.NodeRequirements, change: Any, says: str
) -> None:
    refused = node.refusal_reason(change(terms))
    assert refused is not None
    assert refused.startswith("node ")
    assert "(10.0.0.7)" in refused
    assert says in refused
