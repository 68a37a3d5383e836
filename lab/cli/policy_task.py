"""Says when a policy is given another task than the one that it has learned."""

import sys
from pathlib import Path


def say_other_task(checkpoint: Path, learned: str | None, task: str | None) -> None:
    """Print a note if a policy is to do another task than the one that it has learned.

    Args:
        checkpoint: the policy.
        learned: task of its demonstrations; empty: not known.
        task: task to be done; empty: none.
    """
    if learned and task and learned != task:
        print(f"note: {checkpoint} has learned {learned}; it is given {task}", file=sys.stderr)
