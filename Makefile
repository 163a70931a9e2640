PYTHON ?= $(shell python3.11 -c "" 2>/dev/null && echo python3.11 || echo python3)

.PHONY: demo test check

demo: .venv/.installed
	mkdir -p out
	.venv/bin/slrl-sumo run district --agents 64 --steps 150 --seed 1 \
		--fcd out/fcd.xml --summary out/summary.json --report out/report

test: .venv/.installed-dev
	tools/check.sh

check: test

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/.installed: pyproject.toml | .venv/bin/python
	.venv/bin/python -m pip install --editable ".[report,train,pandas]"
	.venv/bin/python tools/make_machine_code.py
	touch $@

.venv/.installed-dev: pyproject.toml | .venv/bin/python
	.venv/bin/python -m pip install --editable ".[dev]"
	.venv/bin/python tools/make_machine_code.py
	touch .venv/.installed $@
