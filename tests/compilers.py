"""Whether the kernel in C can be had here."""

from functools import cache

from contactlab.engines.contact_kernel import compiled_kernel
from contactlab.errors import CompilerError


@cache
def has_compiler() -> bool:
    """Return whether there is a C compiler that works."""
    try:
        compiled_kernel()
    except CompilerError:
        return False
    return True
