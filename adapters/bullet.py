"""Bullet."""

PACKAGE, REQUIREMENTS = "pybullet", ()
REFUSED = "it gives the bodies of MJCF other masses, without a word"
