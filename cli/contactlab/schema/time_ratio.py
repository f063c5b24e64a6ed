"""A ratio of times with its interval: the one type for the cost of a change."""

import math
from collections.abc import Sequence
from statistics import median

from pydantic import ConfigDict

from contactlab.rendering.amounts import format_amount, format_interval
from contactlab.schema.strict_model import Model, about
from contactlab.shares import SURE, mean_interval, median_interval

BUILD_NOISE = 0.05
"""Difference of two timings of one model on an idle machine, as a share: those without an interval
are equal within it, and no interval needs to be narrower."""

LEAST_SAVING = 0.03
"""Least relevant difference of measured times, as a share of the time: a smaller saving may be gone
in another build of the same model."""

SIMPLER_SHARE = 0.1
"""Share of the time that a simpler fix may cost more: fixes within it rank by simplicity."""


class TimeRatio(Model):
    """A ratio of times, measured in turns from the same states."""

    # Infinite where the engine refuses a model. Reports have no such ratio.
    model_config = ConfigDict(allow_inf_nan=True)

    ratio: float = about("Time with the change over time without.")
    low: float = about("Lower end of its 95 % interval.")
    high: float = about("Its upper end.")

    @classmethod
    def of(cls, ratio: float, low: float, high: float) -> "TimeRatio":
        """Return a ratio with its interval."""
        return cls(ratio=ratio, low=low, high=high)

    @classmethod
    def of_pairs(cls, ratios: Sequence[float]) -> "TimeRatio":
        """Return the median ratio of matched pairs, with the interval of that median.

        Fewer than six have no interval that holds for any distribution: theirs is Student's, of
        the mean of their logarithms.
        """
        least_pairs = 6  # the range of as many misses the median in 2 of 64 cases
        if 1 < len(ratios) < least_pairs and all(0 < ratio < math.inf for ratio in ratios):
            ends = mean_interval([math.log(ratio) for ratio in ratios])
            return cls.of(median(ratios), *map(math.exp, ends))
        return cls.of(median(ratios), *median_interval(ratios))

    @classmethod
    def of_sums(cls, base: Sequence[float], other: Sequence[float]) -> "TimeRatio":
        """Return the ratio of the total times of different samples, such as seeds.

        Samples differ in length and in their ratio, so that the interval contains that spread. For
        a ratio of sums, the deviation of a sample is its residual, in first order (W. G. Cochran,
        Sampling Techniques, 1977, 6.4), with n - 1 degrees of freedom.
        """
        from scipy.special import stdtrit  # noqa: PLC0415 - it takes a while to load

        count, whole = len(base), sum(base)
        ratio = sum(other) / whole
        if not math.isfinite(ratio):
            return cls.of(math.inf, math.inf, math.inf)
        off = [theirs / ratio - own for own, theirs in zip(base, other, strict=True)]
        share = math.sqrt(count / (count - 1) * sum(each * each for each in off)) / whole
        half = float(stdtrit(count - 1, (1 + SURE) / 2)) * share
        return cls.of(ratio, ratio * math.exp(-half), ratio * math.exp(half))

    def is_less(self, than: float = 1.0, *, by: float = 0.0) -> bool:
        """Return whether the interval is below a number, and the ratio is less by a share of it."""
        return self.high < than and self.ratio < than * (1 - by)

    def is_greater(self, than: float = 1.0, *, by: float = 0.0) -> bool:
        """Return whether the interval is above a number, and the ratio is larger by a share."""
        return self.low > than and self.ratio > than * (1 + by)

    def is_equal(self, to: float = 1.0, *, by: float = LEAST_SAVING) -> bool:
        """Return whether the ratio is neither relevantly less nor relevantly greater."""
        return not self.is_less(to, by=by) and not self.is_greater(to, by=by)

    @property
    def text(self) -> str:
        """The ratio with its interval, such as `x0.80 (0.78 to 0.82)`."""
        return f"{format_amount(self.ratio, 'x')} ({format_interval(self.low, self.high, 'x')})"

    @property
    def half_width(self) -> float:
        """Half of the interval, as a share of the ratio; 0 if both are infinite."""
        if math.isinf(self.ratio):
            return 0.0
        return (self.high - self.low) / (2 * self.ratio)

    def scale_ratio(self, factor: float) -> "TimeRatio":
        """Return the ratio to a time that is shorter by an exact factor."""
        return self.of(self.ratio * factor, self.low * factor, self.high * factor)


def cost_class(cost: float) -> float:
    """Return a number that is equal for costs within about a tenth; infinite if not known."""
    return round(math.log(cost, 1 + SIMPLER_SHARE)) if math.isfinite(cost) else math.inf
