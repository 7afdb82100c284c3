"""Keep Python's state of a thread of Zenoh's from one callback to the next.

zenoh-python 1.10 attaches to the interpreter for each callback and detaches after it: a thread
state is made and thrown away for every message, its stack with it (memory mapped and unmapped).

Upstream has no issue yet. It would say: "Threads of the runtime that call Python should hold one
PyGILState reference for their lifetime; with `indirect=False` each message now costs a
PyThreadState_New and PyThreadState_Delete."
"""

import ctypes
import threading

_kept = threading.local()


def keep_thread_state() -> None:
    """Keep what Python holds of the calling thread, as one more user of it, who never leaves."""
    if not hasattr(_kept, "state"):
        _kept.state = ctypes.pythonapi.PyGILState_Ensure()
