# Two commands: `make demo` shows orientd at work, `make test` proves it.
# Each makes the virtual environment it needs from a bare Python 3.11.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
comma = ,

# The runs of `make night`, each a target of its own; their commands are in tests/night.toml.
NIGHT := $(shell sed -n 's/^\[\(.*\)\]$$/\1/p' tests/night.toml)

.PHONY: demo test runs calculates terminals check docs night $(NIGHT) peers lerobot standard proto lock clean

demo: $(VENV)/.user
	$(BIN)/orientd demo

# Tests of real processes mostly wait, so several files of them run at once.  Next to them, at a low priority,
# run the static checks, the tests that only calculate, and those of whole systems in virtual time.
# Tests of terminals run afterwards: while all processors are busy, the kernel passes on the bytes of a
# terminal up to half a second late.  `make night` runs longer tests.
CALCULATES = tests/unit tests/docs orientd adapters drivers sim
SYSTEMS = tests/system tests/drivers tests/chaos tests/storm tests/bench
LEROBOT = examples/lerobot_robot_orientd/tests
VIRTUAL = $(SYSTEMS) tests/world tests/emulated
AT_ONCE ?= 3
PYTEST = $(BIN)/python -m pytest

test: export TESTS_THAT_PASSED = $(CURDIR)/build/passed
test:
	@rm -rf build/passed build/calculates.txt && mkdir -p build/passed
	@$(MAKE) --no-print-directory --keep-going --jobs=2 runs calculates; status=$$?; \
	    test ! -e build/calculates.txt || cat build/calculates.txt; \
	    $(MAKE) --no-print-directory terminals || status=1; \
	    $(BIN)/python tests/promises.py build/passed; exit $$status

runs: $(VENV)/.dev
	@$(PYTEST) --systems processes -n $(AT_ONCE) --dist loadfile $(SYSTEMS) $(LEROBOT)

# A cache of its own: two runs at once write theirs.  What these tests print follows at the end.
CALCULATE = nice -n 15 $(PYTEST) -o cache_dir=build/calculates -n logical

calculates: check
	@mkdir -p build
	@$(CALCULATE) --systems virtual --dist loadfile $(VIRTUAL) $(CALCULATES) > build/calculates.txt 2>&1

terminals: $(VENV)/.dev
	@$(PYTEST) --systems terminals -n 2 --dist loadfile $(SYSTEMS)

check: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	nice -n 15 $(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/python tests/structure.py
	$(BIN)/python tests/prose.py
	$(BIN)/python tests/promises.py

# The site, with its warnings as errors, into build/docs.
docs: $(VENV)/.docs
	rm -rf build/docs
	$(BIN)/python -m sphinx -W --keep-going -q -j auto -b html docs build/docs
	@echo "open build/docs/index.html"

# What takes too long for `make test`: all of it, or one of its runs.  `follow` also builds the site.
night: $(VENV)/.dev $(VENV)/.docs
	$(BIN)/python tests/night.py

follow: $(VENV)/.docs

$(NIGHT): $(VENV)/.dev
	$(BIN)/python tests/night.py $@

# The tables of docs/explanation/comparison.md; a peer that cannot be installed says so there.
PEERS = ruckig toppra splines drake

peers:
	$(PYTHON) -m venv build/peers
	build/peers/bin/python -m pip install --quiet --disable-pip-version-check -e .
	for peer in $(PEERS); do \
	    build/peers/bin/python -m pip install --quiet --disable-pip-version-check $$peer; done; true
	build/peers/bin/python tests/bench/compare_peers.py

# The robot of examples/lerobot_robot_orientd, driven by LeRobot itself; its environment takes 8 GB.
# `make test` runs the same tests with a stand-in for LeRobot.
lerobot:
	$(PYTHON) -m venv build/lerobot
	build/lerobot/bin/python -m pip install --quiet --disable-pip-version-check \
	    -e . -e examples/lerobot_robot_orientd pytest
	build/lerobot/bin/python -m pytest -q -p no:cacheprovider examples/lerobot_robot_orientd

standard: $(VENV)/.dev
	$(BIN)/python tests/data/standard/sequences.py
	$(BIN)/python tests/data/standard/regenerate.py
	$(BIN)/python tests/data/standard/effort.py

# The generated code asks for a runtime at least as new as its generator: the oldest one allowed.
proto:
	$(PYTHON) -m venv build/proto
	build/proto/bin/python -m pip install --quiet --disable-pip-version-check "grpcio-tools==1.78.0"
	build/proto/bin/python -m grpc_tools.protoc -I. --python_out=. --pyi_out=. orientd/protocol/control.proto

$(VENV)/.pip:
	@echo "making the environment $(VENV)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check "pip>=24"
	@touch $@

# An install compiles the kernels: whoever has edited one has them compiled again.
KERNELS = $(wildcard orientd/kernels/c/*.[ch]) orientd/kernels/build.py

$(VENV)/.user: pyproject.toml $(KERNELS) $(VENV)/.pip
	@echo "compiling orientd, and installing what it needs: some minutes without further output"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[plot]"
	@touch $@

# Installs extras in the versions of tests/constraints.txt, or in the newest allowed ones if one of them is missing.
# pip would compile one module after the other, with the tests of all packages, every dialect of MAVLink, and the
# tools that are compiled already or that no test imports.
INSTALL = $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check
define install
@echo "installing orientd with what it needs [$(1)]: some minutes"
@$(INSTALL) -c tests/constraints.txt -e ".[$(1)]" || { \
    echo "not with the versions of tests/constraints.txt: with the newest that are allowed"; \
    $(INSTALL) -e ".[$(1)]"; }
@$(BIN)/python -m compileall -qq -j 0 -x '/site-packages/(.*/(tests?|dialects)|mypyc?|pip|playwright|setuptools)/' $(VENV)/lib || true
endef

$(VENV)/.dev: pyproject.toml tests/constraints.txt $(KERNELS) $(VENV)/.pip
	$(call install,all$(comma)dev)
	@touch $@ $(VENV)/.user

# The reference describes what every extra brings, so the site is built with all of them.
$(VENV)/.docs: pyproject.toml tests/constraints.txt $(KERNELS) $(VENV)/.pip
	$(call install,all$(comma)docs)
	@touch $@ $(VENV)/.user

# The versions that `make test` and `make docs` install, from the newest that pyproject.toml allows.
lock:
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --disable-pip-version-check -e ".[all,dev,docs]"
	{ head -1 tests/constraints.txt; build/lock/bin/python -m pip freeze --exclude-editable | LC_ALL=C sort; } > build/constraints.txt
	mv build/constraints.txt tests/constraints.txt

clean:
	rm -rf $(VENV) dist build .mypy_cache .ruff_cache .pytest_cache .hypothesis
