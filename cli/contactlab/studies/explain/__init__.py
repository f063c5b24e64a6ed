"""Meanings of contactlab's words and of MuJoCo's contact settings: `contactlab explain`."""
