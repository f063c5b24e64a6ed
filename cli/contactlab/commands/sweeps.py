"""`contactlab sweeps`: the shipped sweeps."""

from contactlab.commands.output import Format, FormatOption, print_json, print_table


def sweeps(output: FormatOption = Format.text) -> None:
    """List the shipped sweeps."""
    from contactlab import shipped
    from contactlab.pipeline import Scenes
    from contactlab.plan import read_sweep

    rows: list[tuple[str, str, int, str]] = []
    for name in shipped.sweep_names():
        path = shipped.sweep_file(name)
        read = read_sweep(path, Scenes(path.parent).vocabulary)
        rows.append((name, read.sweep.scene, read.plan.count, read.sweep.description or ""))
    keys = ("sweep", "scene", "runs", "description")
    if output is Format.json:
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
    else:
        print_table(keys, rows)
