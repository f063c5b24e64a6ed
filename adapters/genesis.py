"""Genesis."""

PACKAGE, REQUIREMENTS = "genesis-world", ()
REFUSED = "it takes 8.6 GB, and minutes to compile before its first step"
