"""From a sweep file to runs that need nothing of contactlab."""

from pathlib import Path

from bench.plain import PlainRun

from contactlab.plan.sweep_file import read_sweep
from contactlab.run.sweep_request import SceneLoader


def plain_runs(sweep: Path) -> list[PlainRun]:
    """Return the runs of a sweep, in plan order.

    Restitution is all that it may change in the model, and the number of boxes all in its
    structure.
    """
    scenes = SceneLoader(sweep.parent)
    read = read_sweep(sweep, scenes.vocabulary)
    scene = scenes.open(read.sweep.scene)
    resolved = [
        scene.resolve(run.values, run.seed, read.sweep.duration) for run in read.plan.iterate_runs()
    ]
    qpos, qvel, *_ = scene.initial_states(resolved)
    text = scene.source.model.read_text(encoding="utf-8")
    boxes = resolved[0].structure.get("boxes", 10)
    model = sweep.with_suffix(".xml")
    model.write_text(text.replace('count="10"', f'count="{boxes}"'), encoding="utf-8")
    runs: list[PlainRun] = []
    for row, run in enumerate(resolved):
        edits = run.list_edits()
        solref = edits.pop("solref", None)
        assert not edits, f"the plain runs cannot set {', '.join(edits)}"
        assert solref is None or isinstance(solref, tuple)
        pair = None if solref is None else list(solref)
        runs.append(PlainRun(str(model), pair, qpos[row].tolist(), qvel[row].tolist(), run.steps))
    return runs
