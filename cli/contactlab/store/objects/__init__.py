"""Stores in object storage."""

from contactlab.store.objects.checking import ObjectHoldings
from contactlab.store.objects.fetching import fetched_store, fetched_trace, local_scene
from contactlab.store.objects.object_client import ObjectClient, connect
from contactlab.store.objects.writing import writing_objects

__all__ = [
    "ObjectClient",
    "ObjectHoldings",
    "connect",
    "fetched_store",
    "fetched_trace",
    "local_scene",
    "writing_objects",
]
