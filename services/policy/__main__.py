"""``python -m services.policy CHECKPOINT``; see :mod:`services.policy.command`."""

import os

# Read when numpy is imported. On busy cores several threads of its linear algebra wait for each
# other, and scaling a pair of pictures takes twenty times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from services.policy.command import main

if __name__ == "__main__":
    raise SystemExit(main())
