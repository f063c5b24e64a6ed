"""Whether an engine does what MuJoCo does: `contactlab parity SWEEP --against ENGINE`.

Stage by stage, as MuJoCo's own method has it (`mujoco/doc/skills/parity` in its wheel): single
states, single steps from them, and whole runs, beside what rounding makes of MuJoCo itself.
"""
