"""Give memory that was freed back to the system."""

import contextlib
import ctypes


def trim_heap() -> None:
    """Give back what the C library keeps for later; does nothing where it is not glibc.

    After reading a log, or drawing by software OpenGL, that is tens of megabytes which the next
    stage of a report would come on top of.
    """
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).malloc_trim(0)
