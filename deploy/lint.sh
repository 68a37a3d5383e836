#!/bin/sh
# Style, types and the import rules; the tools are taken from PATH.
set -eu
cd "$(dirname "$0")/.."
ruff check .
ruff format --check .
mypy common services deploy
# Test modules of different areas may share a name, so each area is checked by itself.
for area in tests/*/; do
    mypy "$area"
done
lint-imports
