"""Creates the executor of a SLURM cluster from the resources that each task requests."""

from collections.abc import Generator
from contextlib import contextmanager

from contactlab.errors import ClusterError, optional
from contactlab.run.tasks import Executor


@contextmanager
def slurm_arrays(address: str | None, workers: int | None) -> Generator[Executor]:
    """Yield arrays of `workers` tasks as an executor.

    The address has the resources of each task, by submitit's names: `timeout_min=240,cpus=8`, and
    `cluster=local` for processes of this machine instead. Raises a ClusterError if it is invalid,
    or there is no SLURM; an OutputError if submitit is not installed.
    """
    with optional("slurm", "running on a SLURM cluster"):
        import submitit  # noqa: PLC0415 - an extra
    from contactlab.run.slurm.executor import SlurmExecutor  # noqa: PLC0415 - as above

    requested = dict(map(_parse_entry, filter(None, (address or "").split(","))))
    cluster, cpus = requested.pop("cluster", "slurm"), requested.pop("cpus", 1)
    if not isinstance(cpus, int) or cpus < 1 or cluster not in {"slurm", "local"}:
        raise ClusterError(f"--address {address}: write cpus=N, and cluster=slurm or local")
    if cluster == "slurm" and submitit.SlurmExecutor.affinity() < 0:
        raise ClusterError(
            "there is no SLURM here (no srun); run the command where sbatch is, or try it out with "
            "--address cluster=local"
        )
    default_tasks = 16  # tasks of an array if no number is requested
    executor = SlurmExecutor(workers or default_tasks, cpus, str(cluster), requested)
    try:
        executor.check_parameters()
    except (NameError, TypeError, ValueError) as error:
        raise ClusterError(f"--address {address}: {error}") from error
    yield executor


def _parse_entry(text: str) -> tuple[str, int | str]:
    name, separator, value = text.partition("=")
    if not separator or not name.isidentifier():
        raise ClusterError(
            f"--address {text}: write NAME=VALUE,..., such as timeout_min=240,cpus=8"
        )
    return name, int(value) if value.isdecimal() else value
