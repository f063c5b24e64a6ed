"""Settings that a process of contactlab's own makes first, so that the rest starts fast.

A process of somebody else's, where contactlab is a library, is left as it is.
"""

import atexit
import gc
import os

# Nearly all that is made at the start stays: garbage is looked for after so many new objects.
gc.set_threshold(200_000)
# At the end the system takes all memory back; a last search for garbage would only take time.
atexit.register(gc.freeze)
# Workers have a core each, which BLAS's threads would share.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
# Arrow's own allocators keep what is freed, a tenth of a report's peak, and are no faster here.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
# Pydantic would look through all that is installed for what watches it.
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
