"""Give every reader bent files, by Hypothesis, for as long as asked; each is read or refused.

ATTACK_SECONDS=3600 python -m tests.attack.fuzz
"""

import os
import resource
import sys
import tempfile
import time
import traceback
from contextlib import suppress
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from tests.attack.attack import bounded
from tests.attack.readers import Reader, readers

from contactlab.errors import ContactlabError

BYTES = 6 << 30
EXAMPLES = 50
NESTED = (b"[" * 100_000, b"{" * 2000, b"a: " * 2000, b"&a [*a, *a]")
NUMBERS = (b"1e999", b"NaN", b"null", b"-1", b"{}", b"99999999999999999999", b"\x7f" + b"\xff" * 7)
WORDS = (
    b'"\\ud800"',
    b"\xff\xfe",
    b"../",
    b"/dev/zero",
    b"!!python/object:os",
    b"- ",
    b": ",
    b"\n",
)
PIECES = st.sampled_from((b"", b"\0", b"\t", b"\x1b", bytes(8), *NESTED, *NUMBERS, *WORDS))
EDIT = st.tuples(
    st.floats(0, 1), st.integers(0, 64) | st.just(1 << 40), PIECES | st.binary(max_size=9)
)
EDITS = st.lists(EDIT, min_size=1, max_size=4)


def bent(sound: bytes, edits: list[tuple[float, int, bytes]]) -> bytes:
    """Return a file in which each edit replaces some bytes at a place by others."""
    for place, size, piece in edits:
        start = int(place * len(sound))
        sound = sound[:start] + piece + sound[start + size :]
    return sound


def fuzz(reader: Reader, examples: int, number: int | None = None) -> None:
    """Give a reader so many bent files.

    Raises:
        BaseException: what a reader raises that is no message to a user.
    """

    @settings(
        max_examples=examples,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        report_multiple_bugs=False,
        suppress_health_check=(HealthCheck.too_slow, HealthCheck.data_too_large),
    )
    @given(EDITS)
    def read(edits: list[tuple[float, int, bytes]]) -> None:
        with bounded(), suppress(ContactlabError):
            reader.read(bent(reader.sound, edits))

    (read if number is None else seed(number)(read))()


def main() -> None:
    """Fuzz all readers in turn until the time is over; print what they raised."""
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    end = time.monotonic() + float(os.environ.get("ATTACK_SECONDS", "60"))
    counts: dict[str, int] = {}
    failures: list[str] = []
    with tempfile.TemporaryDirectory(prefix="contactlab-fuzz-") as name:
        known = readers(Path(name))
        while time.monotonic() < end and known:
            for each, reader in list(known.items()):
                try:
                    fuzz(reader, EXAMPLES)
                    counts[each] = counts.get(each, 0) + EXAMPLES
                except BaseException:  # noqa: BLE001 - the others go on
                    failures.append(f"{each}:\n{traceback.format_exc()}")
                    del known[each]
    for each, count in counts.items():
        print(f"{count:9,} files: {each}")
    print("\n".join(failures))
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
