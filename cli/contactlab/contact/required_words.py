"""The words of requirements: of motion, and of pairs in contact."""

from typing import Literal, get_args

MotionWord = Literal["held", "still", "upright", "passes", "stays"]
ContactWord = Literal["sticks", "slides", "rolls", "apart", "presses", "shallow"]
CONTACT_WORDS: tuple[ContactWord, ...] = get_args(ContactWord)
End = Literal["first", "last"]
"""The contact of a pair that a requirement refers to, if not every contact."""
