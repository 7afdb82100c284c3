# `make run` sets up and runs Simulation 1. Tests are in three layers, see CONTRIBUTING.md: `make
# quick` starts no process, `make test` sets up and passes all that carry a safeguard, `make nightly`
# the rest. `make check` lints, `make docs` builds the pages into build/site. `make locks` and `make
# base` record what is installed, by hashes.
PYTHON ?= python3
VENV ?= .venv
PACKAGES := $(wildcard packages/phalanx-*)
READY := $(VENV)/.ready
PYTEST := $(VENV)/bin/python -m pytest -q --durations 10
# Modules in this order: two workers begin at its end, see tests/conftest.py.
LAYERS := -n 4 --dist loadscope --no-loadscope-reorder
# Some environments set it. Every process would compile all modules again.
unexport PYTHONDONTWRITEBYTECODE

BASE := python:3.12-slim
LOCK := uv pip compile --quiet --universal --python-version 3.11.5 --generate-hashes \
	--no-annotate --no-header --constraint constraints.txt pyproject.toml -

.PHONY: run quick test nightly mutants check docs locks base clean

run: $(READY)
	$(VENV)/bin/phalanx run unicycles

quick: $(READY)
	$(PYTEST) -n 2 --dist loadscope -m "not slow and not nightly" tests/unit

test: $(READY)
	@echo "Testing: 5 to 9 minutes on two cores."
	$(PYTEST) $(LAYERS) -m "not nightly" tests/process tests/containers packages tests/unit

nightly: $(READY)
	@echo "Testing what \`make test\` leaves out: 12 to 29 minutes on two cores, or SHARE=I/N of it."
	$(PYTEST) -n 6 -m nightly $(SHARE:%=--share %) tests packages
	$(if $(SHARE),,$(MAKE) mutants ROOM=tonight SAMPLE=15)

mutants: $(READY)
	$(VENV)/bin/python -m tests.hostile.break_room $(ROOM) $(SAMPLE:%=--sample %)

check: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/python .ci/words.py

docs: $(READY)
	$(VENV)/bin/python .ci/reference.py
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet -f docs/site/mkdocs.yml

$(READY): pyproject.toml $(PACKAGES:%=%/pyproject.toml) locks/all.txt
	@echo "Installing Phalanx and its libraries into $(VENV), once: about 2 minutes and 1.5 GB."
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement locks/all.txt
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation $(foreach folder,. $(PACKAGES),--editable $(folder))
	touch $(READY)

# After a change of pyproject.toml or constraints.txt; needs uv. The build's own are beside them.
locks:
	printf '%s\n' hatchling | $(LOCK) packages/phalanx-hosts/pyproject.toml --extra view --no-emit-package phalanx-swarm --output-file locks/image.txt
	printf '%s\n' hatchling editables | $(LOCK) $(PACKAGES:%=%/pyproject.toml) --extra test --extra docs --no-emit-package phalanx-swarm --no-emit-package phalanx-studies --output-file locks/all.txt

# Before a release; needs a container engine that reaches its registry.
base:
	docker pull --quiet $(BASE)
	digest=$$(docker inspect --format '{{index .RepoDigests 0}}' $(BASE)) && \
	sed -i "s|^ARG BASE=.*|ARG BASE=$(BASE)@$${digest##*@}|" Dockerfile

clean:
	rm -rf $(VENV)
