"""NumPy arrays in temporary files, for runs that record more than should be in memory.

The code that computes with them is the same, and so are its results. `disk_arrays.c` is their
memory: files without names, so that nothing is left of them however the process ends.
"""

import ctypes
import os
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import gettempdir

from numpy._core import multiarray

from contactlab.errors import CompilerError, OutputError
from contactlab.native import compile_library

_SET_HANDLER = 304  # place of PyDataMem_SetHandler in NumPy's C interface since 1.22


class DiskMemory(ctypes.CDLL):
    """The library, and its functions that other libraries call in place of realloc and free."""

    in_use = False

    def __init__(self) -> None:
        super().__init__(str(compile_library(Path(__file__).with_suffix(".c"), "-pthread")))
        self.use_files.argtypes = ctypes.c_char_p, ctypes.c_size_t, ctypes.c_size_t
        self.numpy_handler.restype = ctypes.c_void_p
        api = ctypes.pythonapi
        address = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)
        table = address(("PyCapsule_GetPointer", api))(multiarray._ARRAY_API, None)
        functions = ctypes.cast(table, ctypes.POINTER(ctypes.c_void_p))
        switch = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.py_object)
        self.set_handler = switch(functions[_SET_HANDLER] or 0)
        capsule = ctypes.PYFUNCTYPE(
            ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p
        )
        self.functions = tuple(
            ctypes.cast(function, ctypes.c_void_p)
            for function in (self.resize_slots, self.release_slots)
        )
        self.handler = capsule(("PyCapsule_New", api))(self.numpy_handler(), b"mem_handler", None)


@cache
def load_disk_memory() -> DiskMemory | str:
    """Return the library, compiled if it is not in the user's cache, or why it is unavailable."""
    try:
        return DiskMemory()
    except (CompilerError, OSError) as error:
        return str(error)


def disk_memory_in_use() -> DiskMemory | None:
    """Return the library while `arrays_on_disk` is in effect."""
    memory = load_disk_memory() if load_disk_memory.cache_info().currsize else ""
    return memory if isinstance(memory, DiskMemory) and memory.in_use else None


@contextmanager
def arrays_on_disk(least: int = 4 << 20, resident: int = 256 << 20) -> Generator[None]:
    """Let new NumPy arrays of at least `least` bytes lie in temporary files.

    Nothing changes if the library is unavailable.

    Args:
        least: below it, making a file takes longer than filling it.
        resident: bytes of all of them that stay in memory.

    Raises:
        OutputError: the disk of temporary files is full.
    """
    memory = load_disk_memory()
    if isinstance(memory, str):
        yield
        return
    folder = gettempdir()
    if memory.use_files(os.fsencode(folder), least, resident):
        raise MemoryError
    before = memory.set_handler(memory.handler)
    memory.in_use = True
    try:
        yield
    except MemoryError as error:
        if not (number := memory.last_error()):
            raise
        raise OutputError(
            f"{folder}: cannot make files for the arrays of a long run: {os.strerror(number)}; "
            "set TMPDIR to a folder of a larger disk"
        ) from error
    finally:
        memory.in_use = False
        memory.set_handler(before)
        memory.use_files(os.fsencode(folder), 0, resident)
