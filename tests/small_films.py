"""Films of pages with a sixteenth of the pixels and a few pictures; `tests/view` has whole ones."""

from collections.abc import Generator
from contextlib import contextmanager

import pytest

from contactlab.page import header_films

_SMALL = {
    "_SIZE": (80, 60),
    "_FOCAL_SIZE": (120, 90),
    "_SIZE_OF_MOMENT": (120, 90),
    "_SECONDS": 0.15,
    "_SECONDS_OF_MOMENT": 0.2,
}


@contextmanager
def small_films() -> Generator[None]:
    """Draw the films of pages small, which are most of what a page costs."""
    with pytest.MonkeyPatch.context() as patched:
        for name, value in _SMALL.items():
            patched.setattr(header_films, name, value)
        yield
