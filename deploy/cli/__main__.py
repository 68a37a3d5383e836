"""``python -m deploy.cli`` is ``trill``."""

from deploy.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
