"""The files that `tune` and `examine --write` write for robots, and the reports about them.

Searches stop by the clock and choose by times: here both are counted work, so the same code writes
the same files.
"""

import hashlib
from pathlib import Path

from tests.guards.counted_clock import counted_time
from tests.guards.reading import change_facts, tune_facts
from tests.guards.records import Facts, Items

SEARCHING, EXAMINING = "60s", "20s"
"""Limits of each in counted time, which `examine` uses up. A search ends after a few seconds; with
less, it would shorten its runs."""
_SUFFIXES = {".patch", ".xml"}
_MOST_LINES = 200  # of a patch that is recorded, besides its hash


def written_items(name: str, model: Path) -> tuple[Items, Items]:
    """Write files for a robot into the current folder, and return facts of files and reports."""
    # ruff: noqa: PLC0415 - collection is quick without
    import contactlab
    from contactlab.errors import ContactlabError

    reports, words, files = dict[str, Facts](), dict[str, Facts](), dict[str, Facts]()
    for command in ("examine", "tune"):
        item, folder = f"{name}, {command}", Path(command)
        with counted_time():
            try:
                if command == "examine":
                    found = contactlab.examine(
                        model,
                        section=("budget", "fixes"),
                        write=folder / "written.xml",
                        max_cpu=EXAMINING,
                        workers=1,
                        output="examined.json",
                    )
                    reports[item], words[item] = change_facts(found)
                else:
                    found = contactlab.tune(model, output=folder, max_cpu=SEARCHING, workers=1)
                    reports[item], words[item] = tune_facts(found)
            except ContactlabError as error:
                reports[item] = {"refused": type(error).__name__}
                words[item] = {"refused": str(error).replace(f"{model.parent}/", "")}
        for path in sorted(folder.rglob("*")):
            if path.suffix in _SUFFIXES:
                files[f"{name}: {path.as_posix()}"] = _file_facts(path)
    return {"report": reports, "written file": files}, {"report": words}


def _file_facts(path: Path) -> Facts:
    data = path.read_bytes()
    facts: Facts = {"size": len(data), "bytes": hashlib.sha256(data).hexdigest()}
    if path.suffix == ".patch":
        facts["lines"] = data.decode().splitlines()[:_MOST_LINES]
    return facts
