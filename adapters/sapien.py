"""SAPIEN."""

PACKAGE, REQUIREMENTS = "sapien", ()
REFUSED = "it imports no MJCF, and its contacts have impulses, no depth"
