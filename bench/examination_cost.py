"""Counts the evaluations of forces in each part of an examination.

Run: python -m bench.examination_cost MODEL.xml ...

prints, for each model, the evaluations of each part with its row of the error budget or its run of
a verification, the CPU time that they took, and the number of compiled models. A step of RK4 is
four evaluations. Times depend on the machine and its load; counts do not.
"""

import inspect
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType

import mujoco
from mujoco.batch import Batch

import contactlab

PARTS = {
    "_run_task": "task",
    "settle_task": "budget",
    "repair_model": "repair",
    "_search_fixes": "search",
    "recommend_fixes": "recommend",
    "_time_rows": "times of rows",
    "_check_windows": "check",
    "_measure_more": "check",
    "distances_to_reference": "distances",
    "_look_first": "first look",
    "run_loads": "loads",
    "_measure_motions": "motions",
    "_measure_errors": "errors",
    "_count_failure_labels": "labels",
}
"""Names of parts by the function that makes their steps, from outer to inner ones."""
MOST_LINES = 40
EVALUATIONS, COMPILED, SECONDS = Counter[str](), Counter[str](), dict[str, float]()


def list_callers() -> Iterator[FrameType]:
    """Yield the frames of the callers, the innermost first."""
    frame = inspect.currentframe()
    frame = frame.f_back if frame else None
    while frame is not None:
        yield frame
        frame = frame.f_back


def name_part() -> str:
    """Return the part of the examination that makes a step now."""
    names, details = list[str](), list[str]()
    for frame in list_callers():
        function, local = frame.f_code.co_name, frame.f_locals
        if function in PARTS:
            names.append(PARTS[function])
        detail = local.get("row" if function in ("looked", "_measure_rows") else "run")
        if function in ("looked", "_measure_rows", "_compare_states") and hasattr(detail, "name"):
            details.append(str(getattr(detail, "name", "")))
    return " / ".join([*dict.fromkeys(reversed(names)), *details[:1]]) or "others"


def count_rollouts() -> None:
    """Count the evaluations of all batches."""
    make_steps: Callable[..., object] = vars(Batch)["rollout"]

    def count_steps(batch: Batch, steps: int, *arguments: object, **options: object) -> object:
        part, begin, model = name_part(), time.process_time(), batch.model
        stages = 4 if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 1
        try:
            return make_steps(batch, steps, *arguments, **options)
        finally:
            EVALUATIONS[part] += stages * steps * len(batch.state)
            SECONDS[part] = SECONDS.get(part, 0.0) + time.process_time() - begin

    setattr(Batch, "rollout", count_steps)  # noqa: B010 - it is replaced


def count_compilations() -> None:
    """Count the calls that compile a model."""

    def count_calls(owner: type, name: str) -> None:
        own = getattr(owner, name)

        def compile_model(*arguments: object, **options: object) -> object:
            COMPILED[name] += 1
            return own(*arguments, **options)

        setattr(owner, name, compile_model)

    count_calls(mujoco.MjSpec, "compile")
    count_calls(mujoco.MjModel, "from_xml_path")
    count_calls(mujoco.MjModel, "from_xml_string")


def main() -> None:
    """Examine the models, and print their counts."""
    count_rollouts()
    count_compilations()
    for model in sys.argv[1:]:
        for counter in (EVALUATIONS, SECONDS, COMPILED):
            counter.clear()
        begin = time.process_time()
        with TemporaryDirectory() as folder:
            contactlab.examine(model, workers=0, output=Path(folder) / "examined")
        spent, compiled = time.process_time() - begin, COMPILED.total()
        print(f"{model}: {EVALUATIONS.total():,} evaluations, {compiled} compiled, {spent:.1f} s")
        for part, count in EVALUATIONS.most_common(MOST_LINES):
            print(f"{count:12,} {SECONDS[part]:7.2f} s  {part}")


if __name__ == "__main__":
    main()
