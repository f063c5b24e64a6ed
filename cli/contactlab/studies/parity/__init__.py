"""Compares an engine with MuJoCo: `contactlab parity SWEEP --against ENGINE`.

Stage by stage, as MuJoCo's own method has it (`mujoco/doc/skills/parity` in its wheel): single
states, single steps from them, and whole runs, next to the effect of rounding on MuJoCo itself.
"""
