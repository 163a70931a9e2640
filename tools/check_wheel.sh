#!/usr/bin/env bash
# Builds wheel and source archive into the folder $1 (dist), and runs the wheel without extras in a new environment. The
# wheel has machine code for the Python that builds it (slrl_sumo/machine_code); it runs without in other ones.
set -euo pipefail
out=$(realpath -m "${1:-dist}")
cd "$(dirname "$0")/.."
PYTHON=${PYTHON:-python3}

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"$PYTHON" -m venv "$scratch/venv"
PATH="$scratch/venv/bin:$PATH"
pip install --quiet build
python -m build --sdist --outdir "$out"
mkdir "$scratch/source"
tar --extract --strip-components 1 --directory "$scratch/source" --file "$(ls -t "$out"/*.tar.gz | head -1)"
cd "$scratch/source"
pip install --quiet .
PYTHONPATH=$PWD python tools/make_machine_code.py
python -m build --wheel --outdir "$out"
pip install --quiet --force-reinstall --no-deps "$(ls -t "$out"/*.whl | head -1)"
cd "$scratch"
slrl-sumo run intersection --agents 4 --steps 10 --fcd trace.csv --summary summary.json 2>&1 | tee printed
if [ "$(uname -m)" = x86_64 ] && grep "being compiled" printed; then
    echo "the wheel has no machine code" >&2
    exit 1
fi
slrl-sumo replay trace.csv --net intersection --out replay.html
