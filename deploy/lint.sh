#!/bin/sh
# Style, types and the import rules; the tools are taken from PATH.
set -eu
cd "$(dirname "$0")/.."
ruff check .
ruff format --check .
mypy hatch_build.py common services deploy lab verification benchmarks tests docs
lint-imports
