"""Runs jobs on a Ray cluster, by the same workers as on this machine."""

from contactlab.run.cluster.connecting import ray_cluster

__all__ = [
    "ray_cluster",
]
