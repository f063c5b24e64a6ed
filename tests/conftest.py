"""What all tests share."""

import signal
import threading

from hypothesis import settings

# A busy machine is no defect of the code under test.
settings.register_profile("patient", deadline=None)
settings.load_profile("patient")

# A shell makes what it runs in the background deaf to Ctrl-C, and all that is started from there.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and (
    threading.current_thread() is threading.main_thread()
):
    signal.signal(signal.SIGINT, signal.default_int_handler)
