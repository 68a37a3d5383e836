"""``python -m lab.cli`` is ``trill``."""

from lab.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
