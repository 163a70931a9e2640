#!/usr/bin/env bash
# Everything that has to pass before a change is merged; people and CI run the same.
set -euo pipefail
cd "$(dirname "$0")/.."
PATH="$PWD/.venv/bin:$PATH"
# Tests start some hundred interpreters: none should compile our modules anew.
unset PYTHONDONTWRITEBYTECODE

ruff format --check
ruff check
lint-imports
mypy
mypy tools/*.py
# Tests of a module stay together, because they share what is costly to set up.
pytest -n 2 --dist loadscope "$@"
