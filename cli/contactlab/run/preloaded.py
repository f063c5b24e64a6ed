"""Modules that the fork server loads when it imports this one, and workers have when they start.

In any other process, importing it loads nothing.
"""

import os

from contactlab.run.fork_server import IN_FORK_SERVER

# Imported for their effect, in the fork server alone.
# ruff: noqa: F401, PLC0415
# pyright: reportUnusedImport=false


def _load_modules() -> None:
    import contactlab.startup

    # isort: split
    # NumPy loads its two parts when they are used, which would be in each worker.
    import numpy.ma
    import numpy.random

    # Scenes are read by a worker, with this library.
    import ruamel.yaml

    import contactlab.run.worker_pool
    from contactlab.schema.evidence import EvidenceRecord

    EvidenceRecord.model_rebuild()


if os.environ.pop(IN_FORK_SERVER, None):
    _load_modules()
