"""Parts of contactlab that are loaded when used, registered as those of other packages are.

Each function imports and returns one part. What a part needs from an extra is imported with it, so
that a command without the extra works, and one that uses the part names the extra.
"""

from typing import Any

from contactlab.registry import part

# ruff: noqa: PLC0415 - each part is imported when it is used


@part("environment", "mujoco")
def _environment() -> Any:  # noqa: ANN401 - a class
    from contactlab.loop.environment_scene import Environment

    return Environment


@part("executor", "ray")
def _ray() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.ray.connection import ray_cluster

    return ray_cluster


@part("executor", "slurm")
def _slurm() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.slurm.connection import slurm_arrays

    return slurm_arrays


@part("store", "az", "gs", "s3")
def _object_storage() -> Any:  # noqa: ANN401 - a class
    from contactlab.store.objects.backend import ObjectBackend

    return ObjectBackend


@part("viewer", "gif", "mcap", "mp4", "png", "rrd")
def _film() -> Any:  # noqa: ANN401 - a function
    from contactlab.view.render import write_file

    return write_file


@part("viewer", "window")
def _window() -> Any:  # noqa: ANN401 - a function
    from contactlab.view.render import open_viewer

    return open_viewer


@part("wording", "geoms")
def _geoms() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.geom_words import told_of_runs

    return told_of_runs


@part("schema", "lock")
def _lock_schema() -> Any:  # noqa: ANN401 - a class
    from contactlab.studies.lock.lock_model import Lock

    return Lock


@part("schema", "parity")
def _parity_schema() -> Any:  # noqa: ANN401 - a class
    from contactlab.studies.parity.parity_report import ParityReport

    return ParityReport
