"""``python -m verification.fuzz``: random and damaged payloads at every topic's decoder."""

import argparse
import sys
import time

from common.topics import ALL_TOPICS
from verification.fuzz.run import fuzz_topic


def main() -> int:
    """Run; exit code 1 if anything crashed or went uncounted."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.fuzz",
        description="Feed random and damaged payloads to a reader of every topic: nothing may "
        "crash, nothing bad may be shown to a service, and every refusal must be counted.",
    )
    parser.add_argument("--count", type=int, default=100_000, help="per topic (100000)")
    parser.add_argument("--seed", type=int, default=0, help="the same seed, the same payloads (0)")
    options = parser.parse_args()
    print(f"{'topic':<18} {'fed':>8} {'refused':>8} {'applied':>8} {'late':>8} {'slowest ms':>10}")
    started, failed = time.monotonic(), False
    for topic in ALL_TOPICS:
        account = fuzz_topic(topic, options.count, options.seed)
        print(
            f"{account.topic:<18} {account.fed:>8} {account.refused:>8} {account.applied:>8} "
            f"{account.late:>8} {1e3 * account.slowest:>10.2f}",
            flush=True,
        )
        if not account.exact:
            failed = True
            print(f"  {account.crash or 'some payloads are unaccounted for'}", file=sys.stderr)
    print(f"{time.monotonic() - started:.0f} s")
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
