"""Closed loops of servos and controllers, linearized over a step or a control period."""
