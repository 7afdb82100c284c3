# `make run` sets up and runs Simulation 1, `make test` sets up and passes the tests, `make quick`
# only the fast ones, which start no process. `make check` lints, `make docs` builds the pages into
# build/site. `make locks` and `make base` record what is installed, by hashes.
PYTHON ?= python3
VENV ?= .venv
READY := $(VENV)/.ready

BASE := python:3.12-slim
LOCK := uv pip compile --quiet --universal --python-version 3.11.5 --generate-hashes \
	--no-annotate --no-header --constraint constraints.txt pyproject.toml -

.PHONY: run quick test check docs locks base clean

run: $(READY)
	$(VENV)/bin/phalanx run unicycles

quick: $(READY)
	$(VENV)/bin/python -m pytest -q -n 2 --dist loadscope -m "not slow" tests/unit

test: $(READY)
	@echo "Testing: about 15 minutes on two cores; the first minute starts no processes."
	$(VENV)/bin/python -m pytest -q -n 2 --dist loadscope --durations 15 tests/unit
	$(VENV)/bin/python -m pytest -q -n 3 --durations 15 tests/process tests/containers

check: $(READY)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/python .ci/words.py

docs: $(READY)
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --strict --quiet -f docs/site/mkdocs.yml

$(READY): pyproject.toml locks/all.txt
	@echo "Installing Phalanx and its libraries into $(VENV), once: about 2 minutes and 1.5 GB."
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement locks/all.txt
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $(READY)

# After a change of pyproject.toml or constraints.txt; needs uv. The build's own are beside them.
locks:
	printf '%s\n' hatchling | $(LOCK) --output-file locks/image.txt
	printf '%s\n' hatchling editables | $(LOCK) --extra test --extra docs --output-file locks/all.txt

# Before a release; needs a container engine that reaches its registry.
base:
	docker pull --quiet $(BASE)
	digest=$$(docker inspect --format '{{index .RepoDigests 0}}' $(BASE)) && \
	sed -i "s|^ARG BASE=.*|ARG BASE=$(BASE)@$${digest##*@}|" Dockerfile

clean:
	rm -rf $(VENV)
