"""Memory of a process that frees and wants the same large blocks in every step."""

import ctypes

_M_TRIM_THRESHOLD, _M_MMAP_MAX = -1, -4
"""Parameters of ``mallopt``, see mallopt(3)."""
_NEVER = 2**31 - 1


def keep_freed_memory() -> None:
    """Let the process keep memory that is freed, for the next step.

    glibc returns blocks of more than 32 MB to the system at once, which then clears every page of
    them anew: with large pictures a tenth of the time of a step. Other C libraries are left as they
    are.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_MAX, 0)
        mallopt(_M_TRIM_THRESHOLD, _NEVER)
