# `make bounce` runs the main job, `make test` the tests; both build .venv by themselves.
PYTHON ?= python3
BIN := .venv/bin
NODE_READER := tests/store/mcap/node
LIVE := cli/contactlab/live/built/build.json
# The JavaScript reader that a test opens traces with, and the script of pages that simulate.
ifneq ($(shell command -v npm 2>/dev/null),)
NODE_MODULES := $(NODE_READER)/node_modules
WHERE_NPM_IS := $(NODE_MODULES) $(LIVE)
endif
INSTALL ?= $(BIN)/python -m pip install --quiet --disable-pip-version-check
# Neighbouring tests share what they made; who gets idle takes half of what another has left.
# Bytecode is kept whatever the environment says: tests start hundreds of processes that load it.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n auto --dist worksteal

.PHONY: bounce test test-rest test-all test-night test-lowest check lint format stubs schemas guards robot-wheels picture rates changelog constraints wheel
.PHONY: atlas atlas-compare attack bench kernel live site verdicts clean

bounce: .venv/run
	$(BIN)/contactlab sweep bounce

# Every law on small cases, within two minutes on two cores: before each commit.
test: .venv/dev
	$(PYTEST)

# What `make test` leaves to CI: browsers, clusters, object storage, processes, whole catalogues.
test-rest: .venv/dev $(WHERE_NPM_IS)
	$(PYTEST) -m "long and not night and not timed"

test-all: test test-rest

# What takes minutes each: verdicts, attacks, kernels, public robots; and what compares times.
test-night: .venv/dev $(NODE_MODULES)
	HYPOTHESIS_PROFILE=thorough $(PYTEST) -m "night and not timed"
	$(BIN)/python -m pytest -n 0 -m timed

check: lint test

lint: .venv/dev stubs
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python -m tests.prose
	$(BIN)/towncrier build --draft --version next >/dev/null

format: .venv/dev
	$(BIN)/ruff format
	$(BIN)/ruff check --fix
	$(BIN)/python -m tests.prose --lower

# Joins the fragments in changelog.d into a section for the version in pyproject.toml.
changelog: .venv/dev
	$(BIN)/towncrier build --yes

# How often cli/ breaks the rules of prose and names, per 1,000 words, and its functions in numbers.
rates: .venv/dev
	$(BIN)/python -m tests.prose --rates

# MuJoCo ships no type stubs; these are derived from the installed version in seconds.
stubs: .stubs/mujoco-stubs/py.typed
.stubs/mujoco-stubs/py.typed: .venv/dev
	$(BIN)/pybind11-stubgen mujoco -o .stubs --root-suffix=-stubs --ignore-all-errors >/dev/null 2>&1
	printf 'partial\n' > $@

# The schemas, and the pages of docs/reference that list names.
schemas: .venv/dev
	$(BIN)/contactlab list schemas --write schemas
	$(BIN)/python -m docs.generate

# Records results and texts that tests compare. GUARDS=--slow records those of the night, too, and
# GUARDS=--compare says what changed instead; kinds may be named.
guards: .venv/dev
	$(BIN)/python -m tests.guards $(GUARDS)

# Downloads the wheels of the public robots that guards of the night examine into ROBOT_WHEELS.
robot-wheels: .venv/dev
	$(BIN)/python -m tests.guards.robots "$(ROBOT_WHEELS)"

# What `contactlab list sweeps` lists without the engine.
sweeps/index.json: .venv/dev sweeps/*.yaml
	$(BIN)/python -m tests.commands.sweep_index

# The shipped advisories, which lint reads without parsing YAML.
advisories/index.json: .venv/dev advisories/*.yaml
	$(BIN)/python -m tests.advisories.advisory_index

# The script of pages that simulate, with MuJoCo's WebAssembly: takes npm.
live: $(LIVE)

# Builds the wheel, with that script where npm is, and runs it outside the checkout.
wheel: .venv/dev $(filter $(LIVE),$(WHERE_NPM_IS))
	sh .ci/wheel

# The tests with the lowest versions that pyproject.toml allows.
test-lowest: .venv/dev
	sh .ci/lowest

# Bends stores in 2,000 ways, then gives every reader bent files for ATTACK_SECONDS.
ATTACK_SECONDS ?= 3600
attack: .venv/dev
	$(BIN)/python -m tests.attack.attack
	ATTACK_SECONDS=$(ATTACK_SECONDS) $(BIN)/python -m tests.attack.fuzz

# Of models whose truth is known, and of those in the wheels in the folder ROBOT_WHEELS: minutes.
verdicts: .venv/dev
	$(BIN)/python -m tests.verdicts --held-back

# Every hard case as it is written, by contact sensors, and in C by any number of workers: minutes.
kernel: .venv/dev
	WHOLE_CATALOGUE=1 $(BIN)/python -m pytest -n 0 -m night -k every_case \
	  tests/engines/test_contact_kernel.py

bench: .venv/dev
	$(BIN)/python -m bench.overhead

# Examines the robots of wheels that are unpacked in the folder ROBOT_WHEELS, each in a folder of its
# own: minutes to hours for what has no record yet, and none for what has. `make site` shows them.
atlas: .venv/dev
	$(BIN)/python -m bench.atlas run "$(ROBOT_WHEELS)"

# Fails if a verdict differs from the records of the commit ATLAS_BEFORE, and neither a fragment in
# changelog.d nor the newest section of the changelog names its model.
ATLAS_BEFORE ?= origin/main
atlas-compare: .venv/dev
	rm -rf build/atlas-before && mkdir -p build/atlas-before
	git rev-parse --verify $(ATLAS_BEFORE)
	for records in bench/atlas/records atlas/records; do \
	  if git cat-file -e $(ATLAS_BEFORE):$$records 2>/dev/null; then \
	    git archive $(ATLAS_BEFORE) $$records | tar -x -C build/atlas-before; \
	    mv build/atlas-before/$$records build/atlas-before/records; break; fi; done
	$(BIN)/python -m bench.atlas compare build/atlas-before/records

# The film of the README, from real runs.
picture: .venv/dev
	$(BIN)/python -m docs.picture

# The site in build/site; with FILMS=--films the gallery has films and pages, which takes a while.
site: .venv/dev
	$(BIN)/python -m docs.site.build $(FILMS)

constraints: pyproject.toml
	sh .ci/lock

clean:
	rm -rf .venv .stubs build dist results live/node_modules cli/contactlab/live/built

# What runs, by hash; --no-deps and no build isolation keep the editable install from adding any.
.venv/run: .ci/constraints/run.txt pyproject.toml
	$(PYTHON) -m venv .venv || { echo "no venv module: install Python's venv (Debian: python3-venv)" >&2; exit 1; }
	$(INSTALL) --require-hashes -r .ci/constraints/run.txt
	$(INSTALL) --no-deps --no-build-isolation -e .
	touch $@

.venv/dev: .venv/run .ci/constraints/dev.txt
	$(INSTALL) --require-hashes -r .ci/constraints/dev.txt
	$(INSTALL) --no-deps --no-build-isolation -e .
	touch $@

$(NODE_READER)/node_modules: $(NODE_READER)/package.json
	npm install --prefix $(NODE_READER) --no-audit --no-fund --silent --no-package-lock && touch $@ \
	  || echo "npm install failed: the test that reads traces in Node.js is skipped" >&2

$(LIVE): live/package.json live/tsconfig.json live/build.mjs $(wildcard live/src/*.ts)
	npm install --prefix live --no-audit --no-fund --silent --no-package-lock \
	  && npm run --prefix live --silent check && npm run --prefix live --silent build \
	  || echo "not built: pages that simulate (report --live) and their tests are left out" >&2
