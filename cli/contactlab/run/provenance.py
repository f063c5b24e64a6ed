"""What machine and which versions a record comes from."""

import hashlib
import os
import platform
import subprocess
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from contactlab.schema import Engine, Host, Provenance

_CPUINFO = Path("/proc/cpuinfo")


@cache
def engine() -> Engine:
    """Return the engine and its version, without loading it."""
    return Engine(name="mujoco", version=version("mujoco"))


def provenance() -> Provenance:
    """Return what will write the records, with the revision of the folder's git repository."""
    return Provenance(
        contactlab=version("contactlab"),
        git_revision=_revision(),
        python=platform.python_version(),
        numpy=np.__version__,
        host=_host(),
    )


def _host() -> Host:
    info = _cpu_info()
    flags = " ".join(sorted(info.get("flags", "").split()))
    return Host(
        cpu_model=info.get("model name", platform.processor() or platform.machine()),
        cpu_flags=hashlib.sha256(flags.encode()).hexdigest()[:16],
        cores=os.cpu_count() or 1,
        os=f"{platform.system()} {platform.release()}",
    )


def _cpu_info() -> dict[str, str]:
    """Return the first processor's entries; none where the system has no such file."""
    if not _CPUINFO.is_file():
        return {}
    first = _CPUINFO.read_text(encoding="utf-8").split("\n\n")[0]
    pairs = (line.partition(":") for line in first.splitlines())
    return {name.strip(): value.strip() for name, _, value in pairs}


def _revision() -> str | None:
    """Return the commit of the working directory, with `+` if files differ from it."""
    command = ["git", "describe", "--always", "--abbrev=40", "--dirty=+", "--exclude=*"]
    try:
        done = subprocess.run(  # noqa: S603
            command, capture_output=True, text=True, check=True, timeout=10
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
