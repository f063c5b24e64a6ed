"""Tests whether a gripper holds an object: `contactlab grip MODEL`."""
