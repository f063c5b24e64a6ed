"""The fixture `contact_evidence`, in test runs of its own."""

import re
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

TESTS = '''
import mujoco
import pytest

TEXT = """
<mujoco><option timestep="0.002"/><worldbody>
  <geom name="floor" type="plane" size="2 2 .1"/>
  <body name="hand" pos="0 0 .5">
    <geom name="shelf" type="box" size=".1 .1 .01" solref="{solref}"/></body>
  <body name="mug" pos="0 0 .56"><freejoint/>
    <geom name="mug" type="box" size=".05 .05 .05" mass="1" solref="{solref}"/></body>
</worldbody></mujoco>"""
FIRM, SOFT = "0.02 1", "-30 -10"
HOLD = {"subject": "mug", "hold": {"from": 0.2, "relative_to": "hand"}}


def played(evidence, solref, steps=500, **how):
    model = mujoco.MjModel.from_xml_string(TEXT.format(solref=solref))
    recording = evidence.record(model, mujoco.MjData(model), scene=HOLD, **how)
    recording.step(steps)


def test_firm(contact_evidence):
    played(contact_evidence, FIRM)
    assert contact_evidence.stable()
    assert contact_evidence.held("mug", by="hand")


def test_soft(contact_evidence):
    played(contact_evidence, SOFT)
    assert contact_evidence.held("mug", by="hand")


def test_unstable(contact_evidence):
    played(contact_evidence, SOFT)
    assert contact_evidence.stable()


def test_short(contact_evidence):
    played(contact_evidence, FIRM, steps=50)
    assert contact_evidence.held("mug", by="hand")


def test_other(contact_evidence):
    played(contact_evidence, FIRM)
    assert contact_evidence.held("mug", by="floor")


def test_nothing(contact_evidence):
    assert contact_evidence.stable()


@pytest.mark.parametrize("solref", [FIRM])
def test_same(contact_evidence, solref, request):
    played(contact_evidence, solref)
    assert contact_evidence.within(request.config.rootpath / "baseline")
'''


@pytest.fixture
def inner(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makepyfile(test_inner=TESTS)
    return pytester


def run(inner: pytest.Pytester, *options: str) -> pytest.RunResult:
    return inner.runpytest_subprocess("-p", "no:cacheprovider", *options)


@pytest.mark.long
def test_what_is_firm_is_held(inner: pytest.Pytester) -> None:
    run(inner, "-k", "test_firm").assert_outcomes(passed=1)


@pytest.mark.night
@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "soft",
            r"episode 0 \(run \w{8}\) is \w+ at step \d+: shelf-mug is .* m deep",
        ),
        ("unstable", r"episode 0 \(run \w{8}\) is \w+ at step \d+: "),
        ("short", r"episode 0 \(run \w{8}\) ended after 0.1 s, before the start of the hold"),
        ("other", "no declaration says when floor should hold mug; record with scene="),
        ("nothing", r"nothing was recorded; begin with contact_evidence.record"),
        ("same", r"there is no baseline .*; accept this evidence with --contact-baseline update"),
    ],
)
def test_a_failure_says_what_when_and_where(
    inner: pytest.Pytester, name: str, message: str
) -> None:
    result = run(inner, "-k", f"test_{name}", "--contact-evidence", "kept")
    result.assert_outcomes(failed=1)
    text = result.stdout.str()
    assert re.search(message, text), text
    if name in {"soft", "unstable"}:
        assert re.search(r"store: kept/\S+test_\w+", text)
        assert "page: " in text


@pytest.mark.night
def test_a_baseline_is_accepted_then_held(inner: pytest.Pytester) -> None:
    run(inner, "-k", "test_same", "--contact-baseline", "update").assert_outcomes(passed=1)
    run(inner, "-k", "test_same").assert_outcomes(passed=1)
    source = Path("test_inner.py").read_text(encoding="utf-8")
    changed = source.replace('FIRM, SOFT = "0.02 1"', 'FIRM, SOFT = "-30 -10"')
    Path("test_inner.py").write_text(changed, encoding="utf-8")
    result = run(inner, "-k", "test_same")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*(against *baseline)*"])


@pytest.mark.long
def test_a_run_that_does_not_ask_loads_nothing(inner: pytest.Pytester) -> None:
    inner.makepyfile(
        test_inner="""
            import sys

            def test_none():
                heavy = {"contactlab.loop", "contactlab.store", "mujoco", "pyarrow"}
                assert not heavy & set(sys.modules)
        """
    )
    run(inner).assert_outcomes(passed=1)
