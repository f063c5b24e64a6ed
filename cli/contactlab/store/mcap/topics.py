"""Names of the topics of a trace file."""

from urllib.parse import quote, unquote

STATE_TOPIC = "/state"
EVIDENCE_TOPIC = "/evidence"
SCENE_TOPIC = "/scene"
TRANSFORMS_TOPIC = "/tf"
FORCES_TOPIC = "/contact_forces"
_CONTACTS = "/contacts/"


def contacts_topic(pair: str) -> str:
    """Return a pair's topic: bytes other than letters, digits and `_.-~` become %XX."""
    return _CONTACTS + quote(pair, safe="")


def pair_of(topic: str) -> str | None:
    """Return the pair whose contacts a topic holds, or None for another topic."""
    return unquote(topic.removeprefix(_CONTACTS)) if topic.startswith(_CONTACTS) else None
