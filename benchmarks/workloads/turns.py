"""What a process says whose work is measured in turns with other processes'; needs no package.

It waits for a line with a number of steps, takes them and answers with a line of JSON.
"""

import json
import os
import sys
from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any, TextIO


def own_stdout() -> TextIO:
    """Return standard output; what libraries print goes to standard error from now on."""
    mine = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    return mine


def take_turns(out: TextIO, about: dict[str, Any], steps: Callable[[int], float]) -> None:
    """Say ``about``, then take as many steps as each line of standard input asks for.

    Args:
        out: where the answers go.
        about: the first answer.
        steps: takes so many steps and returns their mean loss.
    """
    print(json.dumps(about), file=out)
    for line in sys.stdin:
        wall, cpu = perf_counter(), process_time()
        loss = steps(int(line))
        cost = {"wall": perf_counter() - wall, "cpu": process_time() - cpu}
        print(json.dumps({**cost, "loss": loss}), file=out)
