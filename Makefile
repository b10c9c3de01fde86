# One environment, made from the lock; every other target runs inside it.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check -q
unexport VIRTUAL_ENV PYTHONHOME PYTHONPATH
# The tests run side by side, and small matrices gain nothing from threads.
test slow: export OPENBLAS_NUM_THREADS := 1
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test slow check docs wheel format lock lowest clean

help:  ## list the targets
	@awk -F ':.*## ' '/^[a-z.]+:.*## / {printf "  make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: .venv/.stamp  ## write the report into report/ (more options: make demo ARGS="...")
	$(BIN)/jaxobs demo --out report $(ARGS)

test: check  ## check, then every test that is not slow
	$(BIN)/pytest -m "not slow" -n 2 --dist loadfile

slow: .venv/.stamp wheel  ## the full counts and long runs, the site, and the wheel
	$(BIN)/pytest -m slow -n 2 --dist loadfile

check: .venv/.stamp  ## lint, format and types, changing nothing
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/basedpyright

docs: .venv/.stamp  ## build the documentation into build/site (open build/site/index.html)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

wheel: .venv/.stamp  ## build the wheel and use it in a clean environment, its dependencies at their lower bounds
	$(BIN)/python tests/try_wheel.py

format: .venv/.stamp  ## format the source and mend what the linter can
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

lock: .venv/.stamp  ## bring requirements.lock in line with pyproject.toml (every pin anew: make lock ARGS=--upgrade)
	$(BIN)/pip-compile pyproject.toml --extra dev --output-file requirements.lock --quiet --strip-extras \
	  --allow-unsafe --generate-hashes --no-header --no-annotate \
	  --no-emit-index-url --no-emit-trusted-host --no-emit-find-links $(ARGS)

# The lower bounds of pyproject.toml and what they need, with the tools of the tests that run there.
lowest: .venv/.stamp  ## bring requirements-lowest.txt in line with pyproject.toml
	printf '%s\n' 'beartype>=0.22' 'hypothesis>=6.150' 'pytest>=9.0' | \
	  $(BIN)/uv --quiet pip compile pyproject.toml - --resolution lowest-direct --python-version 3.11 --universal \
	  --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links --output-file requirements-lowest.txt

clean:  ## remove the environment and everything generated
	rm -rf .venv report dist build .hypothesis .pytest_cache .ruff_cache
	find jaxobs tests -name __pycache__ -type d -prune -exec rm -rf {} +

# Rebuilt from nothing when stale: what the lock no longer names must not linger.
.venv/.stamp: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "jaxobs needs Python 3.11 or newer; say which: make PYTHON=python3.11 ..." >&2; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(PIP) install --require-hashes -r requirements.lock
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch $@

.venv: .venv/.stamp  ## the environment
