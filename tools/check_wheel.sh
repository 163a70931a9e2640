#!/usr/bin/env bash
# Builds wheel and source archive into the folder $1 (dist), and runs the wheel without extras in a new environment.
set -euo pipefail
out=$(realpath -m "${1:-dist}")
cd "$(dirname "$0")/.."
PYTHON=${PYTHON:-python3}

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"$PYTHON" -m venv "$scratch/venv"
"$scratch/venv/bin/pip" install --quiet build
"$scratch/venv/bin/python" -m build --outdir "$out"
"$scratch/venv/bin/pip" install --quiet "$out"/*.whl
cd "$scratch"
venv/bin/slrl-sumo run intersection --agents 4 --steps 10 --fcd trace.csv --summary summary.json
venv/bin/slrl-sumo replay trace.csv --net intersection --out replay.html
