"""Run sweeps and tests with other releases of MuJoCo, and list the releases that there are."""

import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from contactlab.errors import EngineError, StoppedError, SweepFileError
from contactlab.run.mujoco_environment import OLDEST, find_interpreter, run_installer
from contactlab.schema.advisory import numbers_of
from contactlab.store.atomic_files import write_errors

_LISTED = re.compile(r"^Available versions: (.+)$", re.MULTILINE)
_FINAL = re.compile(r"\d+(\.\d+)+")
_RAN = {0, 1}  # a sweep that ran, as expected or not; a test that passed, or failed


def find_releases(first: str, last: str, chosen_releases: Sequence[str] = ()) -> list[str]:
    """Return the releases of MuJoCo from one to another, in the order that leads there.

    They are those that pip finds wheels of for this Python, or the given ones. Raises an
    EngineError if they cannot be listed, the first or the last is unknown, or both are the same.
    """
    if first == last:
        raise EngineError(f"{first} is both ends; name two releases")
    for moment in (first, last):
        if _version_numbers(moment) < numbers_of(OLDEST):
            raise EngineError(f"contactlab runs on MuJoCo {OLDEST} and newer; {moment} is older")
    releases = sorted({*chosen_releases} or _list_releases(), key=_version_numbers)
    for moment in (first, last):
        EngineError.unless_known(moment, releases, f"no release {moment} of MuJoCo for this Python")
    start, end = releases.index(first), releases.index(last)
    return releases[start : end + 1] if start <= end else releases[end : start + 1][::-1]


def list_supported_releases() -> list[str]:
    """Return the releases of MuJoCo that contactlab runs on and pip finds wheels of, in order."""
    oldest = numbers_of(OLDEST)
    return sorted(
        (release for release in _list_releases() if numbers_of(release) >= oldest), key=numbers_of
    )


def _list_releases() -> set[str]:
    pip = [sys.executable, "-P", "-m", "pip", "--disable-pip-version-check", "index", "versions"]
    with tempfile.TemporaryDirectory() as empty:
        process = run_installer([*pip, "--only-binary", "mujoco", "mujoco"], Path(empty))
    if (match := _LISTED.search(process.stdout)) is None:
        last_line = (process.stderr.strip().splitlines() or ["it printed nothing"])[-1]
        raise EngineError(
            f"pip cannot list the releases of MuJoCo ({last_line}); name them: --versions"
        )
    return {version for version in match[1].split(", ") if _FINAL.fullmatch(version)}


def _version_numbers(version: str) -> tuple[int, ...]:
    if not _FINAL.fullmatch(version):
        raise EngineError(f"'{version}' is not a release of MuJoCo, such as 3.11.0")
    return numbers_of(version)


def run_python(
    arguments: Sequence[str],
    version: str | None,
    notify: Callable[[str], None],
    *,
    stderr: int | None = None,
) -> "subprocess.CompletedProcess[str]":
    """Run this Python with another release of MuJoCo before the one installed here.

    The arguments are those of the interpreter. Its messages go to stderr, unless that is to be
    `subprocess.PIPE`, and its output is returned. The release is that of the environment that
    `--mujoco` makes; other packages are the same as here. Raises an EngineError if there is no such
    release, or it cannot be installed.
    """
    return subprocess.run(  # noqa: S603
        [sys.executable, *arguments],
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
        check=False,
        env=variables_of_release(version, notify),
    )


def variables_of_release(version: str | None, notify: Callable[[str], None]) -> dict[str, str]:
    """Return the environment variables that make this Python import another release of MuJoCo.

    Raises an EngineError if there is no such release, or it cannot be installed.
    """
    path = [os.environ.get("PYTHONPATH", "")]
    other = find_interpreter(version, notify) if version else None
    if other is not None:
        prefix = str(other.python.parent.parent)
        path.insert(0, sysconfig.get_path("purelib", vars={"base": prefix, "platbase": prefix}))
    return {**os.environ, "PYTHONPATH": os.pathsep.join(folder for folder in path if folder)}


def run_sweep(
    source: str,
    store: Path,
    version: str | None,
    sweep_options: Sequence[str],
    notify: Callable[[str], None],
) -> None:
    """Run or resume a sweep into a store.

    Raises a SweepFileError if it cannot be run, after its own message; a StoppedError if it was
    interrupted.
    """
    arguments = ["-P", "-m", "contactlab", "sweep", source, "-o", str(store), *sweep_options]
    code = run_python(arguments, version, notify).returncode
    if code == StoppedError.exit_code:
        raise StoppedError("interrupted; run the same command again to resume")
    if code not in _RAN:
        raise SweepFileError(f"the sweep cannot be run, as it says above (exit code {code})")


def run_test(node: str, folder: Path, version: str, notify: Callable[[str], None]) -> bool:
    """Return whether a test passes; its output and its records go to a folder.

    Raises a SweepFileError if it did neither pass nor fail.
    """
    with write_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
    # A test is code of the folder that it lies in, and may import from there.
    arguments = ["-m", "pytest", "-q", "-p", "no:cacheprovider", node]
    process = run_python([*arguments, f"--contact-evidence={folder}"], version, notify)
    printed = folder / "pytest.txt"
    printed.write_text(process.stdout, encoding="utf-8")
    if process.returncode not in _RAN:
        raise SweepFileError(f"pytest ended with exit code {process.returncode}; see {printed}")
    return process.returncode == 0
