"""The text of an issue about a small model that fails, ready for a tracker."""

import mujoco

from contactlab.schema.shrink_report import ShrinkReport

_PLAIN = """import mujoco

model = mujoco.MjModel.from_xml_path("model.xml")
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
deepest = 0.0
{table}while data.time < {duration!r} - 1e-9:
{driven}    mujoco.mj_step(model, data)
    deepest = min([deepest, *data.contact.dist])
print("deepest contact [m]:", -deepest)
print("energy [J]:", data.energy, "warnings:", [each.number for each in data.warning])
print("end:", data.qpos)
"""
_TABLE = """with open("controls.csv") as file:
    names, *rows = (line.strip().split(",") for line in file)
table = [[float(value) for value in row] for row in rows]
"""
_DRIVEN = """    row = max((row for row in table if row[0] <= data.time + 1e-9), default=table[0])
    for name, value in zip(names[1:], row[1:]):
        body, _, part = name.rpartition(".")
        if part in ("fx", "fy", "fz", "tx", "ty", "tz"):
            data.body(body).xfrc_applied["fx fy fz tx ty tz".split().index(part)] = value
        else:
            data.actuator(name).ctrl = value
"""
_ONE = {
    "bodies": "body",
    "geoms": "geom",
    "joints": "joint",
    "actuators": "actuator",
    "equalities": "equality",
    "vertices": "vertex",
}


def issue_text(report: ShrinkReport, model: str, *, driven: bool) -> str:
    """Return Markdown: the failure, the model, and how to run it in plain MuJoCo."""
    counts = [(count, kind) for kind, count in report.after.items() if count]
    parts = ", ".join(f"{count} {_ONE[kind] if count == 1 else kind}" for count, kind in counts)
    plain = _PLAIN.format(
        duration=report.duration,
        table=_TABLE if driven else "",
        driven=_DRIVEN if driven else "",
    )
    return f"""# {report.label}: {report.reason}

MuJoCo {mujoco.__version__}; {parts}; {report.duration:g} s from the keyframe `start`\
{", with the inputs of controls.csv" if driven else ""}. It is what is left of a model of \
{report.before["bodies"]} bodies that fails in the same way.

```xml
{model.strip()}
```

In plain MuJoCo:

```python
{plain.strip()}
```

As a labeled run: `contactlab sweep sweep.yaml`.
"""
