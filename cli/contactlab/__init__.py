"""Evidence for contact simulation.

Start with the command line: ``contactlab sweep bounce``. This module imports nothing on
purpose: reading, comparing and drawing stored evidence must not load the physics engine.
"""
