# make run    the daemon on the simulated rig, with live estimates (FOR=10 ends it after 10 s)
# make test   everything that CI checks
#
# Both set up .venv first, on any Debian or Ubuntu with Python 3.11 or later.

PYTHON ?= $(shell for p in python3.13 python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
VENV ?= .venv
BIN := $(VENV)/bin
# several threads of a linear algebra library wait for each other longer than they compute
export OPENBLAS_NUM_THREADS := 1
# each daemon and each test process would translate all sources anew: 3 s of processor time a daemon
unexport PYTHONDONTWRITEBYTECODE
READY := $(VENV)/ready
# what the daemon needs and no more: a first try takes a minute, not the checks' five
RUNS := $(VENV)/runs
PIP := $(BIN)/pip --disable-pip-version-check --no-input -q

# a wheel is the same bytes whoever builds it, whenever
export SOURCE_DATE_EPOCH ?= $(shell git log -1 --format=%ct 2>/dev/null || echo 1700000000)

.PHONY: install rollback uninstall wheelhouse branches mutants audit sbom release
.PHONY: machine-code test-computes test-rest
.PHONY: run test lint format outputs docs notebook unit pythons compiled fuzz fuzz-bytes fuzz-briefly dst blind processes vm wheel bench lock clean

run: $(RUNS)
	$(BIN)/seod run configs/virtual.yaml --start --watch $(if $(FOR),--for $(FOR))

# What uses one processor goes two at a time. By name, not by count of tests: those that take longest are not last.
UNIT := $(BIN)/pytest tests/unit -n auto --dist loadfile --no-loadscope-reorder
BLIND := $(BIN)/pytest tests/blind -n auto
COMPUTES := $(BIN)/pytest tests/blind tests/unit/test_diagnose_*.py -m computes -n auto --dist loadfile --timeout=1200
NOTEBOOK := $(BIN)/pytest -p nbmake.pytest_plugin --nbmake docs/start/notebook.ipynb

# Diagnoses compute, and tests of processes mostly wait: side by side they use all processors.
test: $(READY)
	$(MAKE) --jobs=2 --output-sync=target lint machine-code docs compiled fuzz-briefly notebook
	$(UNIT) -m "not computes"
	$(MAKE) --jobs=2 test-rest test-computes

# It gives way to the daemons of the other tests, and shows what it prints when it has ended. A daemon is a session of its
# own, and Linux shares processors out among sessions first (autogroups): so these are one, too, of the least weight. A module
# at a time: what its tests share is computed once. The time limit is that of a processor that others use first.
test-computes: $(READY)
	@mkdir -p build
	setsid sh -c 'echo 19 2>/dev/null >/proc/self/autogroup; exec nice -n 19 $(COMPUTES)' >build/computes.txt 2>&1 & session=$$!; \
		trap "kill -- -$$session" INT TERM; wait $$session; code=$$?; cat build/computes.txt; exit $$code

test-rest: $(READY)
	$(BIN)/pytest tests --ignore=tests/unit --ignore=tests/blind

# The kernel, compiled once: test processes would each do that at the same moment.
machine-code: $(READY)
	$(BIN)/python -m tests.machine_code

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/prose.py

format: $(READY)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# The site, into build/site; a link that leads nowhere is an error.
docs: $(READY)
	NO_MKDOCS_2_WARNING=true $(BIN)/mkdocs build --strict --quiet

notebook: $(READY)
	$(NOTEBOOK)

# What commands print, into the pages that show it.
outputs: $(READY)
	$(BIN)/python docs/outputs.py

unit: machine-code
	$(UNIT) -m "not slow and not processes"

# The quick unit tests by each supported Python that is at hand, each in an environment of its own. A quarter of an hour for each to
# install and run, so CI has the one that it finds and of the others `compiled`; a release (.ci/release) has all.
PYTHONS := 3.11 3.12 3.13
pythons:
	@for python in $$(.ci/pythons $(PYTHONS)); do \
		name=$$($$python -c 'import sys; print("python%d.%d" % sys.version_info[:2])'); \
		$(MAKE) unit PYTHON=$$python VENV=build/$$name || exit 1; done

# What each of them says of the sources, with nothing installed: two seconds each.
compiled:
	@for python in $$(.ci/pythons $(PYTHONS)); do $$python .ci/compiles.py || exit 1; done

# Bytes by coverage into all that takes them: FOR=600 [s] each; the corpus stays in build/corpus.
fuzz-bytes: $(READY)
	$(BIN)/python bench/fuzz.py --for $(or $(FOR),20)

fuzz-briefly: $(READY)
	$(BIN)/python bench/fuzz.py --for 3 --target jsonrpc,can,serial,text,rig

# New random examples for parsers, configurations and estimators: what fails becomes an @example.
fuzz: $(READY)
	SEOD_EXAMPLES=new $(BIN)/pytest tests/unit -n auto -m hypothesis

# The whole daemon on simulated time, SEEDS runs with faults, on a bus or WIRE=serial, by JOBS processes; a seed that fails is shrunk and shown.
dst: $(READY)
	$(BIN)/python -m tests.dst --seeds $(or $(SEEDS),100) --first $(or $(FIRST),1) --wire $(or $(WIRE),can) --jobs $(or $(JOBS),1)

blind: $(READY)
	$(BLIND)

processes: $(READY)
	$(BIN)/pytest -m processes

vm: $(READY)
	SEOD_REQUIRE_VM=1 $(BIN)/pytest tests/vm

wheel: $(READY)
	$(BIN)/pytest tests/test_wheel.py

bench: $(READY)
	for script in bench/*.py; do $(BIN)/python $$script || exit 1; done

# The service: into /opt/seod, as root. WHEELHOUSE=DIR takes wheels from there and needs no network; upgrades in place.
WHEELHOUSE ?= build/wheelhouse
SERVICE := $(PYTHON) systemd/install.py

install: $(if $(filter build/wheelhouse,$(WHEELHOUSE)),wheelhouse)
	$(SERVICE) install --wheelhouse $(WHEELHOUSE)

rollback uninstall:
	$(SERVICE) $@

# The wheel and all that it needs at run time, as locked: to be copied to a machine without network. What comes as source
# only is built here: over there nothing can be fetched that builds it.
wheelhouse: $(READY)
	rm -rf build/wheelhouse
	$(PIP) download -r requirements-run.lock --require-hashes -d build/wheelhouse
	for source in build/wheelhouse/*.tar.gz; do [ ! -e $$source ] || { \
		$(PIP) wheel --no-deps -w build/wheelhouse $$source && rm $$source; } || exit 1; done
	$(BIN)/python -m build --wheel --no-isolation --outdir build/wheelhouse .
	$(PYTHON) systemd/lock_wheelhouse.py build/wheelhouse

# Unit tests reach each branch of what must not fail: guard, course, supervisor, neutral, the board's clock.
GUARDING := seod/loop/guard.py,seod/loop/course.py,seod/supervisor/*.py,drivers/device_clock.py,drivers/neutral.py
GUARD_TESTS := device_clock device_clock_steps neutral course guard guard_limits guard_switches keeper process supervisor
branches: $(READY)
	$(BIN)/coverage run --branch --include='$(GUARDING)' -m pytest -q \
		$(foreach name,$(GUARD_TESTS),tests/unit/test_$(name).py)
	$(BIN)/coverage report -m --fail-under=100

# Small changes of the same modules that their unit tests see (tests/mutants.py); the goal is 95 % of each.
mutants: $(READY)
	nice -n 10 $(BIN)/python -m tests.mutants

# Advisories about what is locked: any is a failure. Where PyPI's cannot be asked it says so, and fails only with AUDIT=required.
# AUDIT_DATABASE=DIR asks a folder of OSV files, as github.com/pypa/advisory-database has them: without network.
audit: $(READY)
	AUDIT=$(AUDIT) AUDIT_DATABASE=$(AUDIT_DATABASE) $(BIN)/python .ci/audit.py

# What the daemon is made of, for whoever has to know (CycloneDX).
sbom: $(READY)
	$(BIN)/python .ci/sbom.py

release: $(READY)
	.ci/release $(VERSION)

# What is installed, with its hashes, for all supported Python versions at once: requirements-run.lock is what the daemon
# needs, requirements.lock that and the checks' own. `make lock UPGRADE=--upgrade` takes the newest versions.
lock: $(READY)
	$(PIP) install uv
	$(BIN)/uv pip compile -q $(UPGRADE) --universal --python-version 3.11 --extra dev --generate-hashes \
		--no-header --no-annotate pyproject.toml -o requirements.lock
	$(BIN)/uv pip compile -q --universal --python-version 3.11 --generate-hashes \
		--no-header --no-annotate -c requirements.lock pyproject.toml -o requirements-run.lock

$(RUNS): requirements-run.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "seod needs Python 3.11 or later: apt-get install python3 python3-venv"; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
		package=$$($(PYTHON) -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'); \
		test "$$(id -u)" = 0 || { echo "seod needs Python's venv module: sudo apt-get install $$package"; exit 1; }; \
		apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends $$package; }
	$(PYTHON) -m venv $(VENV)
	@echo "installing what seod needs into $(VENV): a minute or two"
	$(PIP) install -r requirements-run.lock
	$(PIP) install --no-deps -e .
	@touch $@

$(READY): requirements.lock $(RUNS)
	$(PIP) install -r requirements.lock
	@touch $@

clean:
	rm -rf .venv build dist mutants *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
