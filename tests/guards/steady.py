"""A made-up machine, whose clock, processor and versions are the same everywhere.

Runs cost a microsecond of CPU a step, and begin and end at one moment.
"""

from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime, tzinfo
from unittest.mock import patch

CPU_PER_STEP = 1e-6  # s
VERSION = "0"
THEN = datetime(2000, 1, 1, tzinfo=UTC)
HOST = {"cpu_model": "CPU", "cpu_flags": "0" * 16, "cores": 1, "os": "OS"}
MACHINE = {
    "contactlab": VERSION,
    "git_revision": None,
    "python": "3",
    "numpy": "2",
    "host": HOST,
}


class _Then(datetime):
    @classmethod
    def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
        del tz
        return THEN


@contextmanager
def made_up_machine() -> Generator[None]:
    """Give runs of this process a made-up machine; worker processes do not have it."""
    # ruff: noqa: PLC0415 - collection is quick without
    from contactlab.engines import impulse
    from contactlab.run import sweep_runner
    from contactlab.schema.evidence import Cost, Provenance
    from contactlab.store import store_files

    costs = Cost.of_steps

    def made_up(cpu: float, steps: int, timestep: float, budget: float | None) -> Cost:
        del cpu
        return costs(steps * CPU_PER_STEP, steps, timestep, budget)

    made = Provenance.model_validate(MACHINE)
    with (
        patch.object(Cost, "of_steps", made_up),
        patch.object(sweep_runner, "find_provenance", lambda: made),
        patch.object(store_files, "datetime", _Then),
        patch.object(impulse, "package_version", lambda _: VERSION),
    ):
        yield
