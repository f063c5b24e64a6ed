"""The contact model in closed form, and the arrays that one rollout leaves."""
