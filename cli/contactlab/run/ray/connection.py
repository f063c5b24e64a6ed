"""Starts Ray on this machine, or connects to a running cluster; no part of it calls home."""

import atexit
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Generator
from contextlib import chdir, contextmanager
from tempfile import mkdtemp
from typing import Any

from contactlab.errors import ClusterError, optional
from contactlab.run.tasks import Executor

# Usage statistics are off. Ray still looks up their address, so it points to this machine.
_RAY_ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_USAGE_STATS_REPORT_URL": "http://127.0.0.1:9/",
    # Nodes run the packages installed there; no environment is packed and sent by `uv run`.
    "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0",
    # Like in other executors. Ray's workers would yield to all other processes, on a busy machine
    # almost forever.
    "RAY_worker_niceness": "0",
    # Ray would print messages about nodes and workers among the results.
    "RAY_DEDUP_LOGS_SKIP_REGEX": ".*",
    # Silences a warning about graphics cards.
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
}
# Time limits for a cluster to open a connection, and to answer [s].
_CONNECT_TIMEOUT, _ANSWER_TIMEOUT = 5.0, 20.0


@contextmanager
def ray_cluster(address: str | None, workers: int | None) -> Generator[Executor]:
    """Yield a Ray cluster as an executor.

    It is the one at HOST:PORT, or for `auto` the one on this machine; `workers` is then the number
    of jobs at a time. Without an address, one is started here, with `workers` CPUs or one for each
    core. Raises a ClusterError if it cannot be reached; an OutputError if Ray is not installed.
    """
    for name, value in _RAY_ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    with optional("ray", "running on a cluster"):
        import ray  # noqa: PLC0415 - an extra, which reads the environment first
    from contactlab.run.ray.executor import RayExecutor  # noqa: PLC0415 - as above

    before = signal.getsignal(signal.SIGTERM)
    try:
        _connect_ray(address, workers)
        if before is not None and signal.getsignal(signal.SIGTERM) is not before:
            # Ray's own handler would end this process without a message.
            signal.signal(signal.SIGTERM, before)
        yield RayExecutor(workers if address else None)
    finally:
        ray.shutdown()


def _connect_ray(address: str | None, workers: int | None) -> None:
    import ray  # noqa: PLC0415 - as above

    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address is None:
        # Size of the object store, for results in flight; a journal line takes a few kB.
        here = {"num_cpus": workers, "object_store_memory": 100 << 20}
        with _in_empty_folder():
            ray.init("local", include_dashboard=False, **here, **quiet)
        return
    # Another process asks the cluster for its health: Ray itself waits for minutes.
    if address.startswith("ray://"):
        raise ClusterError(
            f"{address}: the sweep must run on a node of the cluster; write auto, or the HOST:PORT "
            "of its head node"
        )
    if address != "auto":
        host, _, port = address.rpartition(":")
        if not host or not port.isdecimal():
            raise ClusterError(f"{address}: write HOST:PORT of the cluster's head, or auto")
        try:
            socket.create_connection(
                (host.strip("[]"), int(port)), timeout=_CONNECT_TIMEOUT
            ).close()
        except (OSError, OverflowError) as error:
            raise ClusterError(f"no Ray cluster at {address}: {error}") from error
    options = [] if address == "auto" else ["--address", address]
    command = [sys.executable, "-P", "-m", "ray.scripts.scripts", "health-check", *options]
    try:
        process = subprocess.run(  # noqa: S603
            command, capture_output=True, text=True, timeout=_ANSWER_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise ClusterError(
            f"no Ray cluster answers at {address} within {_ANSWER_TIMEOUT:g} s; is it HOST:PORT of "
            "its head, and is it up?"
        ) from error
    if process.returncode:
        if "InvalidAuthToken" in process.stderr:
            reason = (
                "it requires a token; set RAY_AUTH_MODE=token, with the cluster's RAY_AUTH_TOKEN"
            )
        else:
            lines = process.stderr.strip().splitlines()
            reason = lines[-1] if lines else "its health check failed"
        raise ClusterError(f"no Ray cluster at {address}: {reason}")
    try:
        with _in_empty_folder():
            ray.init(address, **quiet)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise ClusterError(f"no Ray cluster at {address}: {error}") from error


@contextmanager
def _in_empty_folder() -> Generator[None]:
    """Work in an empty folder: Ray's workers import modules from the folder where it starts.

    The current folder may be a stranger's, with a malicious `numpy.py`.
    """
    folder = mkdtemp(prefix="contactlab-nowhere-")
    # The folder exists as long as a worker may look there, so that no user can create one there.
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    with chdir(folder):
        yield
