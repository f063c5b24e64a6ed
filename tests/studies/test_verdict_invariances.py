"""A verdict, its labels and its exit do not depend on duration, names, order, place or units."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from contactlab.plan.task_options import read_task_options
from contactlab.schema.examination import Examination
from contactlab.schema.verdict import PASSING_VERDICTS
from contactlab.studies.examine.examination import ExamineRequest, examine_model
from contactlab.tasks.session import Session

pytestmark = pytest.mark.night


@dataclass(frozen=True)
class Spelling:
    """How one model is written.

    Attributes:
        length, mass: units in one meter and in one kilogram.
        prefix: of all names.
        reverse: whether bodies are written in reverse order.
        frame: attributes of the frame around the world.
        seconds: duration of rest.
    """

    length: float = 1.0
    mass: float = 1.0
    prefix: str = ""
    reverse: bool = False
    frame: str = ""
    seconds: float = 2.0

    def lengths(self, text: str) -> str:
        """Return lengths in this unit."""
        return " ".join(f"{float(word) * self.length:.12g}" for word in text.split())

    def torque(self, amount: float) -> str:
        """Return a torque, or a gain or damping of a hinge, in these units."""
        return f"{amount * self.mass * self.length**2:.12g}"

    def force(self, amount: float) -> str:
        """Return a force in these units."""
        return f"{amount * self.mass * self.length:.12g}"

    def geom(self, kind: str, size: str, kilograms: float = 1.0, more: str = "") -> str:
        """Return a geom with a mass."""
        mass = f"{kilograms * self.mass:.12g}"
        return f'<geom type="{kind}" size="{self.lengths(size)}" mass="{mass}" {more}/>'

    def body(self, name: str, place: str, inside: str, joint: str = "<freejoint/>") -> str:
        """Return a body."""
        place = self.lengths(place)
        return f'<body name="{self.prefix}{name}" pos="{place}">{joint}{inside}</body>'

    def floor(self, more: str = "") -> str:
        """Return a fixed plane."""
        return (
            f'<geom name="{self.prefix}floor" type="plane" size="{self.lengths("9 9 1")}" {more}/>'
        )


Parts = Callable[[Spelling], Sequence[str]]


def box(spelling: Spelling, more: str = "", name: str = "box", height: float = 0.05) -> str:
    inside = spelling.geom("box", ".1 .08 .05", more=more)
    return spelling.body(name, f"0 0 {height}", inside)


def slope(spelling: Spelling, degrees: float, more: str = "") -> list[str]:
    return [spelling.floor(), box(spelling, more), f"TILT {degrees}"]


def stack(spelling: Spelling, heavy: float) -> list[str]:
    top = spelling.body("top", "0 0 .15", spelling.geom("box", ".1 .08 .05", heavy))
    return [spelling.floor(), box(spelling), top]


def arm(spelling: Spelling, gain: float) -> list[str]:
    joint = f'<joint name="{spelling.prefix}turn" axis="0 1 0" damping="{spelling.torque(2)}"/>'
    inside = spelling.geom("sphere", ".05", more=f'pos="{spelling.lengths(".3 0 0")}"')
    servo = f'<position joint="{spelling.prefix}turn" kp="{spelling.torque(gain)}"/>'
    return [spelling.body("arm", "0 0 1", inside, joint), f"<actuator>{servo}</actuator>"]


def pendulum(spelling: Spelling, links: int, more: str = "") -> list[str]:
    inside = ""
    for link in range(links, 0, -1):
        joint = f'<joint axis="0 1 0" damping="{spelling.torque(0.02)}" {more}/>'
        bob = spelling.geom("sphere", ".05", more=f'pos="{spelling.lengths("0 0 -.3")}"')
        inside = spelling.body(
            f"link{link}", "0 0 -.3" if link > 1 else "0 0 1", bob + inside, joint
        )
    return [inside]


def drawer(spelling: Spelling, softness: str) -> list[str]:
    hold = f'frictionloss="{spelling.force(4)}" {softness}'
    joint = f'<joint type="slide" axis="1 0 0" {hold}/>'
    inside = spelling.geom("box", ".1 .08 .05")
    return [spelling.body("drawer", "0 0 1", inside, joint), "TILT 10"]


def tied(spelling: Spelling, kind: str, softness: str) -> list[str]:
    hung = spelling.body("lamp", "0 0 .6", spelling.geom("box", ".1 .08 .05"))
    anchor = f'anchor="{spelling.lengths("0 0 .05")}"' if kind == "connect" else ""
    turns = f'torquescale="{spelling.length:g}"' if kind == "weld" else ""
    tie = f'<{kind} body1="{spelling.prefix}lamp" {anchor} {turns} {softness}/>'
    return [hung, f"<equality>{tie}</equality>"]


def lift(spelling: Spelling, newtons: float) -> list[str]:
    damping = f"{200 * spelling.mass:.12g}"
    up = f'<joint name="{spelling.prefix}up" type="slide" axis="0 0 1" damping="{damping}"/>'
    fork = spelling.geom("box", ".2 .2 .02", 2)
    crate = spelling.body("crate", "0 0 .17", spelling.geom("box", ".1 .1 .05", 10))
    limit = spelling.force(newtons)
    servo = (
        f'<position joint="{spelling.prefix}up" kp="{4000 * spelling.mass:.12g}" '
        f'forcerange="-{limit} {limit}"/>'
    )
    return [
        spelling.floor(),
        spelling.body("fork", "0 0 .1", fork, up),
        crate,
        f"<actuator>{servo}</actuator>",
        f'<keyframe><key ctrl="{spelling.lengths(".3")}"/></keyframe>',
    ]


def overlap(spelling: Spelling) -> list[str]:
    top = spelling.body("top", "0 0 .12", spelling.geom("box", ".1 .08 .05"))
    return [spelling.floor(), box(spelling), top]


# No box slides: the friction of pyramids depends on its direction, so a turned slope is another
# model.
MODELS: dict[str, Parts] = {
    "box": lambda spelling: [spelling.floor(), box(spelling)],
    "soft box": lambda spelling: [spelling.floor(), box(spelling, 'solref=".1 1"')],
    "ball": lambda spelling: [
        spelling.floor(),
        spelling.body("ball", "0 0 .1", spelling.geom("sphere", ".1")),
    ],
    "rod": lambda spelling: [
        spelling.floor(),
        spelling.body("rod", "0 0 .03", spelling.geom("capsule", ".03 .2", more='euler="0 90 0"')),
    ],
    "light slope": lambda spelling: slope(spelling, 5),
    "creeping slope": lambda spelling: slope(spelling, 25),
    "soft slope": lambda spelling: slope(spelling, 20, 'solref=".05 1"'),
    "stack": lambda spelling: stack(spelling, 1),
    "heavy stack": lambda spelling: stack(spelling, 30),
    "arm": lambda spelling: arm(spelling, 200),
    "weak arm": lambda spelling: arm(spelling, 4),
    "pendulum": lambda spelling: pendulum(spelling, 1),
    "two links": lambda spelling: pendulum(spelling, 2),
    "tight limit": lambda spelling: pendulum(spelling, 1, 'range="20 60" limited="true"'),
    "drawer": lambda spelling: drawer(spelling, ""),
    "soft drawer": lambda spelling: drawer(spelling, 'solreffriction=".5 1"'),
    "lamp on a point": lambda spelling: tied(spelling, "connect", ""),
    "lamp on a soft weld": lambda spelling: tied(spelling, "weld", 'solref=".2 1"'),
    "lift": lambda spelling: lift(spelling, 400),
    "weak lift": lambda spelling: lift(spelling, 60),
    "overlap": overlap,
}
SPELLINGS = {
    "1 s": Spelling(seconds=1.0),
    "5 s": Spelling(seconds=5.0),
    "renamed": Spelling(prefix="zz_"),
    "reversed": Spelling(reverse=True),
    "moved and turned": Spelling(frame='pos="3 -2 .7" euler="0 0 37"'),
    "mm and g": Spelling(length=1e3, mass=1e3),
}


def write_model(parts: Parts, spelling: Spelling) -> str:
    bodies = list[str]()
    sections, tilt = "", ""
    for part in parts(spelling):
        if part.startswith("TILT"):
            tilt = f'euler="0 {part.split()[1]} 0"'
        elif not part.startswith(("<body", "<geom")):
            sections += part
        else:
            bodies.append(part)
    bodies = bodies[::-1] if spelling.reverse else bodies
    width = f"{1e-3 * spelling.length:g}"
    return f"""<mujoco>
      <option gravity="0 0 {-9.81 * spelling.length:.12g}"/>
      <default><geom solimp=".9 .95 {width}"/><equality solimp=".9 .95 {width}"/></default>
      <worldbody><frame {spelling.frame}><frame {tilt}>{"".join(bodies)}</frame></frame></worldbody>
      {sections}</mujoco>"""


def examine(parts: Parts, spelling: Spelling, folder: Path) -> Examination:
    folder.mkdir()
    file = folder / "model.xml"
    file.write_text(write_model(parts, spelling), encoding="utf-8")
    options = read_task_options(duration=f"{spelling.seconds}s", drive="none", seeds=1)
    sections = ("labels", "budget")
    return examine_model(
        ExamineRequest(str(file), task=options, sections=sections), Session(folder / "out", 0)
    )


@pytest.mark.parametrize("name", MODELS)
def test_a_verdict_is_the_same_however_a_model_is_written(name: str, tmp_path: Path) -> None:
    known = examine(MODELS[name], Spelling(), tmp_path / "plain")
    for place, (way, spelling) in enumerate(SPELLINGS.items()):
        found = examine(MODELS[name], spelling, tmp_path / str(place))
        assert (way, found.verdict) == (way, known.verdict)
        labels = [{label.label for label in report.labels} for report in (found, known)]
        assert labels[0] == labels[1], way
        assert [cause.stage for cause in found.causes] == [cause.stage for cause in known.causes]
        assert found.passed == known.passed == (known.verdict in PASSING_VERDICTS)
