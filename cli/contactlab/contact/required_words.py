"""The words of what has to hold: of motion, and of pairs in contact."""

from typing import Literal, get_args

MotionWord = Literal["held", "still", "upright", "passes", "stays"]
ContactWord = Literal["sticks", "slides", "rolls", "apart", "presses", "shallow"]
CONTACT_WORDS: tuple[ContactWord, ...] = get_args(ContactWord)
End = Literal["first", "last"]
"""The contact of a pair that a word is said of, where it is not each of them."""
