"""The corpus is read as it is written, and every model has what its case names."""

import json
import re
import shutil
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import pytest
from tests.verdicts.corpus import FOLDER, CorpusError, read_corpus, read_part
from tests.verdicts.motion import watch

from contactlab.expression import ExpressionError

PARTS = sorted(file.parent.name for file in FOLDER.glob("*/truth.json"))
_KINDS = ("BODY", "JOINT", "GEOM", "SITE", "TENDON", "ACTUATOR", "EQUALITY", "FLEX")
NAMED = [getattr(mujoco.mjtObj, f"mjOBJ_{kind}") for kind in _KINDS]


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
def test_models_have_what_is_named(part: str) -> None:
    for case in read_part(FOLDER / part).cases:
        texts = [case.text(healthy=healthy) for healthy in case.told]
        models = [mujoco.MjModel.from_xml_string(text) for text in texts]
        for model, name in product(models, case.where):
            assert max(mujoco.mj_name2id(model, kind, name) for kind in NAMED) >= 0
        try:
            case.truth.measure(watch(texts[-1], 12 * models[-1].opt.timestep))
        except ExpressionError as error:
            # A part of the motion may begin later than that.
            if not re.search(r"zero-size|out of bounds", str(error)):
                raise


@pytest.mark.parametrize("sealed", sorted(FOLDER.glob("*.sha256")), ids=lambda path: path.stem)
def test_sealed_part_is_as_it_was(sealed: Path) -> None:
    """The hash is `find PART -type f | LC_ALL=C sort | xargs sha256sum | sha256sum` there."""
    files = [path for path in sealed.with_suffix("").rglob("*") if path.is_file()]
    names = sorted(path.relative_to(FOLDER).as_posix() for path in files)
    lines = [f"{sha256((FOLDER / name).read_bytes()).hexdigest()}  {name}\n" for name in names]
    expected = sealed.read_text(encoding="utf-8").split()[0]
    assert sha256("".join(lines).encode()).hexdigest() == expected


def test_parts_that_are_held_back_come_last_and_are_named_so(part: Path) -> None:
    for name in ("held_back_9", "a_part"):
        other = part.with_name(name)
        shutil.copytree(part, other)
        write(other, CASE)
    parts = read_corpus(part.parent)
    assert [(found.name, found.held_back) for found in parts] == [
        ("a_part", False),
        ("falls", False),
        ("held_back_9", True),
    ]


def test_names_are_unique() -> None:
    names = [case.name for part in read_corpus() for case in part.cases]
    assert len({*names}) == len(names)


# Nothing but its weight acts on the ball, so that it falls by g t^2 / 2 but for the first order of
# the semi-implicit step, which takes it g h t / 2 further.
FALL = """<mujoco><option timestep="<<h>>"/><worldbody><body name="ball"><freejoint/>
<geom size=".1"/></body></worldbody></mujoco>"""
CASE: dict[str, Any] = {
    "name": "a fall",
    "kind": "loss",
    "model": "fall.xml",
    "failing": {"h": 0.1},
    "healthy": {"h": 0.01},
    "truth": "max(abs(body('ball')[:, 2] + 9.81 / 2 * time ** 2)) / 0.4",
    "limit": 0.2,
    "duration": 0.4,
    "reason": "A fifth of the size that it falls by.",
}


@pytest.fixture
def part(tmp_path: Path) -> Path:
    folder = tmp_path / "falls"
    folder.mkdir()
    (folder / "fall.xml").write_text(FALL, encoding="utf-8")
    write(folder, CASE)
    return folder


def write(folder: Path, *cases: object, **others: object) -> None:
    told = {"part": folder.name, "about": "Of a test.", "source": "A test.", "cases": cases}
    (folder / "truth.json").write_text(json.dumps(told | others), encoding="utf-8")


def test_case_of_two_files_has_its_models_and_truth(part: Path) -> None:
    [case] = read_part(part).cases
    assert case.told == (False, True)
    for healthy, step in ((False, 0.1), (True, 0.01)):
        motion = watch(case.text(healthy=healthy), case.duration)
        assert motion.model.opt.timestep == step
        # g h t / 2 at t = 0.4, to the rounding of 40 sums.
        assert case.truth.measure(motion) == pytest.approx(9.81 * step / 2, rel=1e-9)


def test_case_may_tell_one_model_alone(part: Path) -> None:
    for missing in ("failing", "healthy"):
        write(part, CASE | {missing: None})
        [case] = read_part(part).cases
        assert case.told == (missing == "failing",)
        with pytest.raises(ValueError, match=f"has no {missing} model"):
            case.text(healthy=missing == "healthy")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nature": "soft"}, "nature: Input should be 'numerical', 'model' or 'sound'"),
        ({"limit": "high"}, "limit: Input should be a valid number"),
        ({"limit": 0.0}, "limit: Input should be greater than 0"),
        ({"durations": 2.0}, "durations: Extra inputs are not permitted"),
        ({"drive": {"kind": "sine"}}, "drive: Extra inputs are not permitted"),
        ({"model": "other.xml"}, "No such file .*other.xml"),
        ({"model": "../fall.xml"}, "model: String should match pattern"),
        ({"failing": {"k": 1}}, r"failing has \['k'\], but its model leaves \['h'\]"),
        ({"failing": None, "healthy": None}, "failing and healthy are both null"),
        ({"failing": {"h": 0.01}}, "have the same numbers"),
        ({"truth": "max(bodies('ball'))"}, "truth: .* at character 4: the functions are "),
        ({"truth": "max(body('ball')[:, 2]"}, "truth: .* at character .*: not an expression"),
        ({"reason": " "}, "reason: String should have at least 1 character"),
    ],
)
def test_malformed_case_is_named_with_its_file(
    part: Path, change: dict[str, object], message: str
) -> None:
    write(part, CASE | change)
    with pytest.raises(CorpusError, match=rf"falls.truth\.json: case 'a fall': .*{message}"):
        read_part(part)


def test_case_without_a_name_is_counted(part: Path) -> None:
    write(part, CASE, {key: value for key, value in CASE.items() if key != "name"})
    with pytest.raises(CorpusError, match=r"truth\.json: case '1': name: Field required"):
        read_part(part)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"truth\.json: Expecting property name"),
        ("[]", r"truth\.json: Input should be a valid dictionary"),
        ('{"part": "falls", "about": "", "source": "A.", "cases": [1]}', "about: String should"),
        (
            '{"part": "rises", "about": "A.", "source": "A.", "cases": [{}]}',
            "part is 'rises', but the folder 'falls'",
        ),
    ],
)
def test_malformed_part_is_named(part: Path, text: str, message: str) -> None:
    (part / "truth.json").write_text(text, encoding="utf-8")
    with pytest.raises(CorpusError, match=message):
        read_part(part)


def test_same_name_and_model_of_no_case_are_refused(part: Path) -> None:
    write(part, CASE, CASE)
    with pytest.raises(CorpusError, match="case 'a fall': another case has this name"):
        read_part(part)
    write(part, CASE)
    (part / "stray.xml").write_text(FALL, encoding="utf-8")
    with pytest.raises(CorpusError, match=r"no case has the model stray\.xml"):
        read_part(part)
