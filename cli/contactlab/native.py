"""The kernel in C: compiled on first use by the user's compiler, kept in the user's cache.

CONTACTLAB_KERNEL=off does without.
"""

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from contactlab.errors import CompilerError, install_command
from contactlab.resources import open_user_cache, user_cache

# Without fused multiplications, which round once where NumPy rounds twice.
_FLAGS = ("-std=c11", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")


def is_wanted() -> bool:
    """Return whether the kernel may be used."""
    return os.environ.get("CONTACTLAB_KERNEL") != "off"


def compile_library(source: Path, *arguments: str, version: str = "") -> Path:
    """Return a C file as a shared library, compiled unless it is in the user's cache.

    Args:
        source: the file.
        arguments: further arguments of the compiler: folders of headers, other libraries.
        version: that of the other libraries; it is part of the name.

    Raises:
        CompilerError: there is no compiler, or it fails, or the cache is of others.
    """
    command = [*_FLAGS, str(source), *arguments]
    key = hashlib.sha256("\0".join([version, platform.platform(), *command]).encode())
    key.update(source.read_bytes())
    folder = open_user_cache()
    if folder is None:
        raise CompilerError(f"others may write to {user_cache()}")
    name = "-".join(filter(None, [source.stem, version, key.hexdigest()[:12]]))
    target = folder / f"{name}.so"
    if target.exists():
        return target
    # Two processes may compile it at once; each replaces the file as a whole.
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        library = Path(temporary) / target.name
        command = [*_find_compiler(), *command, "-o", str(library)]
        most_seconds = 120  # A compiler that takes longer hangs.
        try:
            subprocess.run(  # noqa: S603 - the user's own compiler
                command, check=True, capture_output=True, timeout=most_seconds
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise CompilerError(f"no C compiler that works: {error}") from error
        return library.replace(target)


def _find_compiler() -> list[str]:
    """Return the command that the user named, or the system's, or ziglang's."""
    if named_compiler := shlex.split(os.environ.get("CC", "")):
        return named_compiler
    if system_compiler := shutil.which("cc"):
        return [system_compiler]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-P", "-m", "ziglang", "cc"]
    raise CompilerError(
        f"no C compiler; install cc, or {install_command('fast')}, or set CONTACTLAB_KERNEL=off"
    )
