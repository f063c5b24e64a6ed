"""Stores in object storage; the library that talks to it is an extra, loaded when one is used."""

from contactlab.evidence.objects.checking import ObjectHoldings
from contactlab.evidence.objects.client import Client, connect
from contactlab.evidence.objects.fetching import fetched_store, fetched_trace, local_scene
from contactlab.evidence.objects.writing import writing_objects

__all__ = [
    "Client",
    "ObjectHoldings",
    "connect",
    "fetched_store",
    "fetched_trace",
    "local_scene",
    "writing_objects",
]
