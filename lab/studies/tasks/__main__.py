"""``python -m lab.studies.tasks run door/unlock --seeds 0:25``: how often the operator succeeds."""

import sys

from common.errors import ConfigError
from common.packages import require


def main() -> int:
    """Run the study; returns the exit code."""
    try:
        require("python -m lab.studies.tasks", "study", "mujoco", "pinocchio", "rich", "scipy")
    except ConfigError as error:
        print(error, file=sys.stderr)
        return 2
    from lab.studies.tasks import command

    return command.main()


if __name__ == "__main__":
    raise SystemExit(main())
