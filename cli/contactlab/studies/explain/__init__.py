"""Definitions of contactlab's words, and MuJoCo's contact settings in units of the world."""
