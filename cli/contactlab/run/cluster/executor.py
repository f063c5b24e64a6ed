"""Jobs as tasks of a Ray cluster: each counts once, whatever becomes of the nodes."""

import pickle
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

import ray
from ray import cloudpickle

from contactlab.run.cluster import node
from contactlab.run.cluster.flight import Flight
from contactlab.run.cluster.parcel import packed
from contactlab.run.cluster.terms import check_nodes, set_terms
from contactlab.run.job import Job, Result, Task
from contactlab.run.stop import Stop


@dataclass(frozen=True)
class RayExecutor:
    """The cluster that this process is connected to.

    Attributes:
        most: how many jobs may be on it at once; None for two for each CPU, so that none idles.
    """

    most: int | None = None

    @property
    def workers(self) -> int:
        """How many jobs run at once; CPUs may come and go."""
        cpus = max(1, int(ray.cluster_resources().get("CPU", 0)))
        return min(cpus, self.most or cpus)

    def run(self, task: Task, jobs: Iterable[Job], stop: Stop) -> Iterator[Result]:
        """Yield the results of jobs as they come; see `Executor`.

        Raises:
            ClusterError: a node cannot run them.
        """
        cloudpickle.register_pickle_by_value(node)
        with set_terms(task) as terms:
            check_nodes(terms)
            # In a list, a reference is followed only by processes that do not have it yet.
            shared = [ray.put(terms), ray.put(packed(task))]
            remote: Any = ray.remote(num_cpus=1, max_retries=0)(node.run_job)

            def send(job: Job) -> Any:  # noqa: ANN401 - a reference, which Ray types so
                return remote.remote(terms.token, shared, pickle.dumps(job))

            queue = takewhile(lambda _: not stop.is_set, jobs)
            yield from Flight(send, queue, self._room, stop).results()

    def _room(self) -> int:
        return self.most or 2 * self.workers
