"""The atlas: public robots as their wheels carry them, each with its verdict and error budget.

Nothing depends on the wheels: they are unpacked in a folder, one folder each. `python -m atlas run`
examines what has no record yet, `python -m atlas compare` says which verdicts are others than those
of another atlas, and `docs.site.atlas` makes pages of the records.
"""

from contactlab.parts import register_parts

register_parts()
