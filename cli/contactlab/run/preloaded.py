"""Modules that the fork server loads, and workers have when they start."""

import os
from importlib import import_module

# GLFW starts a process as MuJoCo loads it, and cannot draw without a display.
without_glfw = not os.environ.keys() & {"DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"}
if without_glfw:
    os.environ["MUJOCO_GL"] = "disable"
# NumPy loads its two parts when they are used, which would be in each worker.
for module in ("contactlab.startup", "numpy.ma", "numpy.random", "contactlab.run.worker_pool"):
    import_module(module)
import_module("contactlab.schema.evidence").EvidenceRecord.model_rebuild()
if without_glfw:
    del os.environ["MUJOCO_GL"]
