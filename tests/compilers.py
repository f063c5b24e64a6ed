"""Whether functions in C can be had here."""

from functools import cache
from pathlib import Path

from contactlab.errors import CompilerError
from contactlab.measure import net_contact
from contactlab.native import compiled


@cache
def has_compiler() -> bool:
    """Return whether there is a C compiler that works."""
    try:
        compiled(Path(net_contact.__file__).with_suffix(".c"))
    except CompilerError:
        return False
    return True
