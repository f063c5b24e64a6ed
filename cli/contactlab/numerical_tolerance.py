"""Relative tolerances for numbers that are equal up to rounding, in three levels.

A comparison multiplies a level by the size of the compared numbers. A double has a relative
precision of `eps` = 2.2e-16, and a single-precision number one of 1.2e-7.

A difference that matters physically is not rounding: such limits stay where they are judged.
"""

ROUNDING = 1e-12
"""Rounding of some operations in a row, such as norms and means of a few values: 4,500 eps."""

SUM_ROUNDING = 1e-9
"""Rounding of results of many operations: 4.5 million eps.

These are sums over a run, factorizations of matrices, and chains of rotations. A time that is the
sum of a million equal steps is off by at most a share of 6e-11; a factorization loses a factor of
its condition number, 1e6 for models of parts that differ as much in mass.
"""

COARSE_ROUNDING = 1e-6
"""Rounding of numbers that were less precise on their way: 8 times that of single precision.

These are numbers from text with seven digits, forces of an iterative solver, and times in steps:
the sum of 100,000 equal steps is off by at most 6e-7 of a step.
"""
