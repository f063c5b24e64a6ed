"""`contactlab sweeps`: the shipped sweeps."""

from contactlab.commands.output import Format, FormatOption, print_json, print_table


def sweeps(output: FormatOption = Format.text) -> None:
    """List the shipped sweeps."""
    from contactlab import resources
    from contactlab.plan import read_sweep
    from contactlab.run import Scenes

    rows: list[tuple[str, str, int, str]] = []
    for name in resources.sweep_names():
        path = resources.sweep_file(name)
        read = read_sweep(path, Scenes(path.parent).vocabulary)
        rows.append((name, read.sweep.scene, read.plan.count, read.sweep.description or ""))
    keys = ("sweep", "scene", "runs", "description")
    if output is Format.json:
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    else:
        print_table(keys, rows)
