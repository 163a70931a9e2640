#!/usr/bin/env bash
# Everything that has to pass before a change is merged; people and CI run the same.
set -euo pipefail
cd "$(dirname "$0")/.."
PATH="$PWD/.venv/bin:$PATH"

ruff format --check
ruff check
lint-imports
mypy
pytest "$@"
