"""``python -m verification.fuzz``: feed random and damaged payloads to every topic's decoder."""

import argparse
import logging
import sys
import time

from common.program import run_program
from common.topics import ALL_TOPICS
from verification.fuzz.run import fuzz_topic


def main() -> int:
    """Run; return 1 if anything crashed or went uncounted."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.fuzz",
        description="Feed random and damaged payloads to a reader of every topic. Nothing may "
        "crash, a service must never see bad values, and every refusal must be counted.",
    )
    parser.add_argument("--count", type=int, default=100_000, help="payloads per topic (100000)")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same payloads")
    options = parser.parse_args()
    return run_program("fuzz", lambda: run(options.count, options.seed), "stopped")


def run(count: int, seed: int) -> int:
    """Feed ``count`` payloads to each topic's reader; return 1 if one is not accounted for."""
    logging.disable(logging.WARNING)
    print(f"{'topic':<18} {'fed':>8} {'refused':>8} {'applied':>8} {'late':>8} {'slowest ms':>10}")
    started, failed = time.monotonic(), False
    for topic in ALL_TOPICS:
        result = fuzz_topic(topic, count, seed)
        print(
            f"{result.topic:<18} {result.fed:>8} {result.refused:>8} {result.applied:>8} "
            f"{result.late:>8} {1e3 * result.slowest:>10.2f}",
            flush=True,
        )
        if not result.complete:
            failed = True
            print(f"  {result.crash or 'some payloads are not accounted for'}", file=sys.stderr)
    print(f"{time.monotonic() - started:.0f} s")
    return int(failed)


if __name__ == "__main__":
    raise SystemExit(main())
