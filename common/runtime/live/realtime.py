"""Use real-time scheduling for this process, where the system permits it."""

import os

DEFAULT_PRIORITY = 20


def enter_realtime(priority: int) -> str:
    """Ask for SCHED_FIFO for this thread and every thread it starts from now on.

    Call it before the bus is opened, so that the transport's threads inherit it. Without permission
    scheduling stays normal.

    Args:
        priority: 1 to 99; 0: leave scheduling as it is.

    Returns:
        the scheduling in force: ``"SCHED_FIFO 20"``, ``"normal"`` or ``"normal (SCHED_FIFO 20 not
        permitted)"``.
    """
    if priority <= 0:
        return "normal"
    wanted = f"SCHED_FIFO {priority}"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError):  # no permission, or a system without this call
        return f"normal ({wanted} not permitted)"
    return wanted
