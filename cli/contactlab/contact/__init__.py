"""The contact model in closed form, and the arrays of one rollout."""
