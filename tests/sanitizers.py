"""Tests of functions in C, again with sanitizers that stop at whatever C leaves undefined."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_FLAGS = "-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer -g"


def run_sanitized(file: str, chosen: str, cache: Path) -> str:
    """Run the chosen tests of a file (the `-k` of pytest), and return what pytest says."""
    found = subprocess.run(
        ["cc", "-print-file-name=libasan.so"], capture_output=True, text=True, check=False
    ).stdout.strip()
    if not Path(found).is_absolute():
        pytest.skip("the compiler has no runtime of AddressSanitizer")
    environment = os.environ | {
        "CC": f"cc {_FLAGS}",
        "LD_PRELOAD": str(Path(found).resolve()),
        # Python does not free all that it has, and so does not MuJoCo.
        "ASAN_OPTIONS": "detect_leaks=0",
        "XDG_CACHE_HOME": str(cache),
    }
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider"]
    command += ["-m", "long or not long", "-k", chosen, file]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert " passed" in done.stdout
    assert "skipped" not in done.stdout
    return done.stdout
