"""Studies of one scene or model: check, effects and stability."""
