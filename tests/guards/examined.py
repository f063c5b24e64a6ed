"""The verdict, the labels and the shares of models, which depend on no clock.

Time is counted work, and there is enough of it for all rows of a budget.
"""

from pathlib import Path
from typing import Any

from tests.guards.counted_clock import counted_time
from tests.guards.reading import examination_facts
from tests.guards.records import Facts, Items
from tests.verdicts.corpus import Case

ENOUGH = "1h"
"""CPU for all rows of any model here; most take seconds."""
_SECTIONS = ("labels", "budget")


def case_items(case: Case) -> tuple[Items, Items]:
    """Examine the models of a case, the current folder being empty."""
    results, words = dict[str, Facts](), dict[str, Facts]()
    for healthy in case.told:
        name = f"{case.name}, {'healthy' if healthy else 'failing'}"
        path = Path("healthy.xml" if healthy else "failing.xml")
        path.write_text(case.text(healthy=healthy), encoding="utf-8")
        results[name], words[name] = examine(path, drive="none", duration=f"{case.duration} s")
    return {"model": results}, {"model": words}


def robot_items(name: str, path: Path) -> tuple[Items, Items]:
    """Examine a robot, the current folder being empty."""
    results, words = examine(path)
    return {"robot": {name: results}}, {"robot": {name: words}}


def examine(path: Path, **task: Any) -> tuple[Facts, Facts]:
    """Return results and words of an examination, or the error that refuses the model."""
    # ruff: noqa: PLC0415 - collection is quick without
    import contactlab
    from contactlab.errors import ContactlabError

    with counted_time():
        try:
            report = contactlab.examine(
                path, section=_SECTIONS, max_cpu=ENOUGH, workers=1, output="examined.json", **task
            )
        except ContactlabError as error:
            return {"refused": type(error).__name__}, {
                "refused": str(error).replace(f"{path.parent}/", "")
            }
    results, words = examination_facts(report)
    # A fix that was not searched names the command, with the path of this machine.
    return results, words | {"fix": str(words["fix"]).replace(f"{path.parent}/", "")}
