"""Films of pages with a sixteenth of the pixels and a few pictures; `tests/view` has whole ones."""

from collections.abc import Generator
from contextlib import contextmanager

import pytest

from contactlab.page import header_films
from contactlab.page.header_films import FilmRules


@contextmanager
def small_films() -> Generator[None]:
    """Draw the films of pages small, which are most of what a page costs."""
    small = FilmRules(size=(80, 60), moment_size=(120, 90), seconds=0.15, moment_seconds=0.2)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(header_films, "FILM_RULES", small)
        yield
