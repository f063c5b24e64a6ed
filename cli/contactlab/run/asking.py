"""From a sweep file to what `run_sweep` is asked."""

from pathlib import Path

from contactlab.plan import Overrides, read_sweep
from contactlab.run.newer import lenient, trimmed
from contactlab.run.sweep import Ask
from contactlab.run.vocabulary import Scenes
from contactlab.schema import effects_base
from contactlab.store import Address


def ask_for(  # noqa: PLR0913 - one argument an option
    source: Path | str,
    name: str,
    store: Address,
    *,
    folder: Path,
    workers: int,
    overrides: Overrides | None = None,
    fresh: bool = False,
    partly: bool = False,
    retry_failed: bool = False,
) -> Ask:
    """Read a sweep and return what to run.

    Args:
        source: the sweep file's path, or its text.
        name: the sweep's name.
        store: where the store is written.
        folder: where relative paths of scenes start.
        workers: processes; 0 for none but this one.
        overrides: options of the command line.
        fresh: whether to replace a store that is there.
        partly: whether to leave out what only newer engines can do, rather than to refuse it.
        retry_failed: whether stored runs that failed are run again.

    Raises:
        SweepFileError: the file or the options hold mistakes; all are named.
    """
    options = overrides or Overrides()
    scenes = Scenes(folder)
    vocabulary = lenient(scenes.vocabulary) if partly else scenes.vocabulary
    read = read_sweep(source, vocabulary, options)
    possible = trimmed(read.plan)
    return Ask(
        plan=possible.plan,
        scene=scenes.open(read.sweep.scene).with_effects(effects_base(read.sweep.effects)),
        name=name,
        source=read.text,
        overrides=_given(options),
        store=store,
        workers=workers,
        fresh=fresh,
        left_out=possible.reasons,
        retry_failed=retry_failed,
    )


def _given(overrides: Overrides) -> tuple[str, ...]:
    limit = () if overrides.limit is None else (f"--limit {overrides.limit}",)
    return (
        *(f"--set {each}" for each in overrides.assign),
        *(f"--only {each}" for each in overrides.only),
        *limit,
    )
