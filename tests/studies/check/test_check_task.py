"""The check of a model's task fails wherever its examination does not call the model sound."""

from collections.abc import Callable

import pytest

from contactlab.errors import SweepFileError
from contactlab.schema.check_report import CheckResult, Measure
from contactlab.schema.examination import Examination

Checked = Callable[..., Examination]
Missed = Callable[[CheckResult], list[Measure]]

ROD = """<mujoco><option timestep=".01"/><worldbody><geom type="plane" size="3 3 .1"/>
<body name="rod" pos="0 0 .3" euler="0 40 10"><freejoint/><geom type="capsule" size=".02 .2"/>
</body></worldbody></mujoco>"""


def test_the_check_judges_what_a_run_may_be_off_by(checked: Checked, missed: Missed) -> None:
    """References at a quarter and an eighth of the step leave the share of a falling rod in doubt.

    They differ by more than the share itself. So a tolerance of the share is met by the share, and
    not by its upper bound; a tolerance of that difference is met by both.
    """

    def largest_miss(tolerance: float, word: str) -> float:
        report = checked(
            ROD,
            "task",
            assign=("timestep=0.005",),
            duration="0.6s",
            drive="none",
            tolerance=(tolerance, "1"),
            seeds=1,
        )
        assert report.task_verdict
        assert report.task_verdict.verdict == word
        (result,) = report.checks
        return max((measure.value or 0.0 for measure in missed(result)), default=0.0)

    share = largest_miss(1e-6, "inaccurate")
    bound = largest_miss(share, "undecided")
    assert bound - share > share
    assert largest_miss(bound - share, "ok") == 0.0


def test_a_phase_has_steps_of_which_a_fifth_says_what_rests(checked: Checked) -> None:
    with pytest.raises(SweepFileError, match=r"at most 0\.04 s"):
        checked(ROD, "task", assign=("timestep=0.041",), duration="0.6s")
    assert checked(ROD, "task", assign=("timestep=0.04",), duration="0.6s").verdict
