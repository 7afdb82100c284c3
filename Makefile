# `make run` sets up and runs Simulation 1, `make test` sets up and passes the tests, `make docs`
# builds the pages into build/site.
PYTHON ?= python3
VENV ?= .venv
READY := $(VENV)/.ready

.PHONY: run test check docs clean

run: $(READY)
	$(VENV)/bin/phalanx run unicycles

test: $(READY)
	@echo "Testing: about 15 minutes on two cores; the first minute starts no processes."
	$(VENV)/bin/python -m pytest -q -n 2 --dist loadscope --durations 15 tests/unit
	$(VENV)/bin/python -m pytest -q -n 2 --durations 15 tests/process tests/containers

check: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet -f docs/site/mkdocs.yml

$(READY): pyproject.toml constraints.txt
	@echo "Installing Phalanx and its libraries into $(VENV), once: about 2 minutes and 1.5 GB."
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,docs]'
	touch $(READY)

clean:
	rm -rf $(VENV)
