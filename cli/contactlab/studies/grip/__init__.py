"""Whether a gripper holds: found, closed on an object, loaded: `contactlab grip MODEL`."""
