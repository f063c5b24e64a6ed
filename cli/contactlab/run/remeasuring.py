"""Time stored runs on command: what `contactlab compare --remeasure` talks to.

Run: python -m contactlab.run.remeasuring STORE

Each line of the input asks for a run: {"run": id, "repeats": n}. Each line of the output answers:
{"seconds": CPU time, "steps": made}, or {"error": why not}. The first line says who answers.
"""

import gc
import json
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from contactlab.engines import Course, count_work, time_course
from contactlab.errors import ContactlabError
from contactlab.run.replay import stored_run
from contactlab.scene import compile_plain, prepare_plain, quiet
from contactlab.store import Store

MOST_STEPS = 2_000
"""Steps that are timed from each of the places along a run."""


def answers(store: Store, lines: Iterator[str]) -> Iterator[dict[str, Any]]:
    """Yield who answers, then an answer to each line."""
    yield {"engine": f"mujoco {version('mujoco')}", "contactlab": version("contactlab")}
    courses: dict[str, Course] = {}
    for line in lines:
        asked = json.loads(line)
        try:
            run = str(asked["run"])
            if run not in courses:
                # One at a time: what is timed in turns is the same run in two processes.
                courses = {run: course_of(store, run)}
            seconds, steps = time_course(courses[run], MOST_STEPS, int(asked["repeats"]))
            yield {"seconds": seconds, "steps": steps}
        except ContactlabError as error:
            yield {"error": str(error)}


def course_of(store: Store, run: str) -> Course:
    """Return a stored run, ready to be timed from several places along it.

    Raises:
        ContactlabError: there is no such run, or it does not go through with this engine.
    """
    _, scene, resolved = stored_run(store, run)
    start = scene.starts([resolved])
    model = prepare_plain(scene, resolved, start, compile_plain(scene, resolved))
    work = count_work(model, start, resolved.steps)
    if work is None:
        raise ContactlabError(f"run {run} does not go through")
    return Course(model, start, work.places, work.states, work.steps)


def main() -> None:
    """Answer until the input ends."""
    quiet()
    gc.disable()
    try:
        for answer in answers(Store.open(Path(sys.argv[1])), iter(sys.stdin.readline, "")):
            sys.stdout.write(json.dumps(answer) + "\n")
            sys.stdout.flush()
    except ContactlabError as error:
        raise SystemExit(f"error: {error}") from error


if __name__ == "__main__":
    main()
