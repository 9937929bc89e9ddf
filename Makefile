# make run    the daemon on the simulated rig, with live estimates (FOR=10 ends it after 10 s)
# make test   everything that CI checks
#
# Both set up .venv first, on any Debian or Ubuntu with Python 3.11 or later.

PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
BIN := .venv/bin
# several threads of a linear algebra library wait for each other longer than they compute
export OPENBLAS_NUM_THREADS := 1
READY := .venv/ready
PIP := $(BIN)/pip --disable-pip-version-check --no-input -q

.PHONY: run test lint format outputs docs notebook install unit fuzz blind processes vm wheel bench lock clean

run: $(READY)
	$(BIN)/seod run configs/virtual.yaml --start --watch $(if $(FOR),--for $(FOR))

test: lint docs
	$(BIN)/pytest tests/unit -n auto --dist loadfile
	$(BIN)/pytest tests/blind -n auto
	$(BIN)/pytest tests --ignore=tests/unit --ignore=tests/blind
	$(BIN)/pytest --nbmake docs/start/notebook.ipynb

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(READY)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# The site, into build/site; a link that leads nowhere is an error.
docs: $(READY)
	NO_MKDOCS_2_WARNING=true $(BIN)/mkdocs build --strict --quiet

notebook: $(READY)
	$(BIN)/pytest --nbmake docs/start/notebook.ipynb

# On a test bench, as Debian's packages lay things out, in an environment of its own: root, or DESTDIR.
PREFIX ?= /usr/local
LIB ?= /opt/seod
install:
	$(PYTHON) -m venv $(DESTDIR)$(LIB)
	$(DESTDIR)$(LIB)/bin/pip --disable-pip-version-check --no-input -q install -c requirements.lock .
	install -d $(DESTDIR)$(PREFIX)/bin $(DESTDIR)/etc/seod $(DESTDIR)/lib/systemd/system $(DESTDIR)$(PREFIX)/share/seod
	ln -sf $(LIB)/bin/seod $(DESTDIR)$(PREFIX)/bin/seod
	install -m 644 systemd/*.service $(DESTDIR)/lib/systemd/system
	cp -r configs $(DESTDIR)$(PREFIX)/share/seod

# What commands print, into the pages that show it.
outputs: $(READY)
	$(BIN)/python docs/outputs.py

unit: $(READY)
	$(BIN)/pytest tests/unit -n auto --dist loadfile -m "not slow and not processes"

# New random examples for parsers, configurations and estimators: what fails becomes an @example.
fuzz: $(READY)
	SEOD_EXAMPLES=new $(BIN)/pytest tests/unit -n auto -m hypothesis

blind: $(READY)
	$(BIN)/pytest tests/blind -n auto

processes: $(READY)
	$(BIN)/pytest -m processes

vm: $(READY)
	SEOD_REQUIRE_VM=1 $(BIN)/pytest tests/vm

wheel: $(READY)
	$(BIN)/pytest tests/test_wheel.py

bench: $(READY)
	for script in bench/*.py; do $(BIN)/python $$script || exit 1; done

# Newest versions within the bounds of pyproject.toml, for all supported Python versions at once.
lock: $(READY)
	$(PIP) install uv
	$(BIN)/uv pip compile -q --upgrade --universal --python-version 3.11 --extra dev \
		--no-header --no-annotate pyproject.toml -o requirements.lock

$(READY): requirements.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "seod needs Python 3.11 or later: apt-get install python3 python3-venv"; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
		package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
		test "$$(id -u)" = 0 || { echo "seod needs Python's venv module: sudo apt-get install $$package"; exit 1; }; \
		apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends $$package; }
	$(PYTHON) -m venv .venv
	$(PIP) install -r requirements.lock
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch $@

clean:
	rm -rf .venv build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
