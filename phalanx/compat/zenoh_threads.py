"""Keep Python's thread state of Zenoh's threads between callbacks.

zenoh-python 1.10 attaches to the interpreter for each callback and detaches after it: for every
message a thread state and its stack are allocated and freed (memory mapped and unmapped).

Upstream has no issue yet. Its text: "Threads of the runtime that call Python should hold one
PyGILState reference for their lifetime; with `indirect=False` each message now costs a
PyThreadState_New and PyThreadState_Delete."
"""

import ctypes
import threading

_kept = threading.local()


def keep_thread_state() -> None:
    """Keep the calling thread's state by one reference that is never released."""
    if not hasattr(_kept, "state"):
        _kept.state = ctypes.pythonapi.PyGILState_Ensure()
