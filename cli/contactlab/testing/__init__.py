"""A plug-in of pytest: the fixture `contact_evidence`, which records loops and judges them."""
