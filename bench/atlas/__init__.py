"""The atlas: public robots as their wheels carry them, each with its verdict and error budget.

Nothing depends on the wheels: each is unpacked into a folder of its own. `python -m bench.atlas
run` examines robots that have no record yet. `python -m bench.atlas compare` prints verdicts that
differ from those of another atlas. `docs.site.atlas` makes pages of the records.
"""

from contactlab.parts import register_parts

register_parts()
