# The two commands of the README: `make herd` and `make test`. Both need Python >= 3.11 alone.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: help herd test ros lint format docs peers wheel bench twinbench plans reproduce physical patterns teams mixed scenes leaderboard flown zoo lock clean

help:  ## Show this list
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

herd: $(VENV)/run.stamp  ## Teach a sheepdog from nothing, fly it, and write runs/herd/report.html
	$(BIN)/skydog herd $(ARGS)

test: $(VENV)/dev.stamp  ## Run the tests
	$(BIN)/python -m pytest -n auto --dist loadfile $(ARGS)

lint: $(VENV)/dev.stamp  ## Check style and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

format: $(VENV)/dev.stamp  ## Put the code into its format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(VENV)/dev.stamp  ## Build the site, and run its notebook: build/site/index.html
	$(BIN)/sphinx-build -W --keep-going -q -b html docs build/site

peers: $(VENV)-peers/stamp  ## Show what other libraries say of our environments, and learn in them
	$(VENV)-peers/bin/python -m pytest -o addopts= --noconftest -s tests/envs/test_checkers.py tests/envs/test_sb3.py \
		tests/envs/test_sb3_worlds.py tests/envs/test_torchrl.py

ros: $(VENV)/dev.stamp  ## Put ROS 1 (Debian: rospy and its master, 5 MB) beside the environment
	.ci/ros $(BIN)/python

wheel: $(VENV)/dev.stamp  ## Install the wheel into an empty environment, and use it there
	.ci/wheel

bench: $(VENV)/dev.stamp $(VENV)-peers/stamp  ## Compare with SB3, SBX and VMAS: docs/benchmarks.md
	$(BIN)/python benchmarks/bench.py --out docs/benchmarks.md
	$(BIN)/python benchmarks/scaling.py --out docs/scaling.md

twinbench: $(VENV)/dev.stamp $(VENV)-twin-peers/stamp  ## Compare the twin with crazyflow and RotorPy: docs/twin_benchmarks.md
	$(BIN)/python benchmarks/twin.py --out docs/twin_benchmarks.md

plans: $(VENV)/run.stamp  ## Search anew for the best-known plans; continues where it was interrupted
	$(BIN)/python benchmarks/plans.py --out runs/plans $(ARGS)
	cp runs/plans/plans-*.csv src/skydog/study/data

reproduce: $(VENV)/run.stamp  ## Regenerate the paper's simulation study, and docs/reproduces.md
	$(BIN)/skydog reproduce $(ARGS)
	cp runs/reproduce/reproduces.md runs/reproduce/*.png docs

physical: $(VENV)/dev.stamp  ## Regenerate the paper's physical study in the twin, and docs/physical.md
	$(BIN)/skydog reproduce --physical $(ARGS)
	cp runs/physical/physical.md docs

teams: $(VENV)/run.stamp  ## Regenerate the study of several dogs, and docs/teams.md
	$(BIN)/skydog reproduce --teams $(ARGS)
	cp runs/teams/teams.md runs/teams/teams.png docs

patterns: $(VENV)/run.stamp  ## Regenerate the study of El-Fiqi's six patterns, and docs/patterns.md
	$(BIN)/skydog reproduce --patterns $(ARGS)
	cp runs/patterns/patterns.md runs/patterns/patterns.png docs

mixed: $(VENV)/run.stamp  ## Regenerate the study of mixed flocks, and docs/mixed.md
	$(BIN)/skydog reproduce --mixed $(ARGS)
	cp runs/mixed/mixed.md runs/mixed/mixed.png docs

scenes: $(VENV)/run.stamp  ## Regenerate the study of scenes, and docs/obstacles.md
	$(BIN)/skydog reproduce --scenes $(ARGS)
	cp runs/scenes/obstacles.md runs/scenes/obstacles.png docs

FLAT := ppo:runs/recipes/ppo-herd-5.zip sac:runs/recipes/sac-herd-5.zip td3:runs/recipes/td3-herd-5.zip
BOARD := strombom elfiqi arc rearmost team team:h-ddpg-4x4 lama ring dhrl-4x4 h-ddpg-4x4 h-ddpg-6x6
leaderboard: $(VENV)/dev.stamp $(VENV)-peers/stamp  ## Fly the benchmark with all that ships, and write docs/leaderboard.md
	$(BIN)/skydog bench $(BOARD) --out runs/board $(ARGS)
	$(VENV)-peers/bin/python benchmarks/recipes.py --only ppo-herd sac-herd td3-herd --seeds 5
	$(VENV)-peers/bin/skydog bench $(FLAT) --out runs/board $(ARGS) \
		--trained "1 to 4 minutes of one core: [the recipes](recipes.md)"
	cp runs/board/*.json src/skydog/study/data/board
	$(BIN)/skydog bench --out runs/board
	cp runs/board/leaderboard.md docs

flown: ros  ## Fly the laboratory's chain for an hour, and write docs/flown.md
	$(BIN)/python benchmarks/lab.py --out docs/flown.md

zoo:  ## Ship the sheepdogs that make reproduce and make physical chose
	cp runs/reproduce/zoo/* src/skydog/shepherds/zoo
	cp runs/physical/zoo/* src/skydog/shepherds/zoo

lock: $(VENV)/dev.stamp  ## Resolve the dependencies anew
	$(BIN)/python -m pip install uv
	$(BIN)/uv pip compile $(LOCK) --group build -o locks/run.txt pyproject.toml
	$(BIN)/uv pip compile $(LOCK) $(EXTRAS:%=--extra %) --group build --group dev --group docs -o locks/dev.txt pyproject.toml
LOCK := --quiet --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
	--no-emit-index-url --upgrade --custom-compile-command "make lock"
# All but sb3, which brings torch.
EXTRAS := fast tensorboard watch pettingzoo onnx scenes video twin lab ros1 crazyflie mavlink window ray

clean:  ## Remove what make installed; runs stay
	rm -rf $(VENV) $(VENV)-peers $(VENV)-twin-peers

# An exact lock with hashes, then the package itself, built by what the lock installed.
define install
	@echo "Installing into $(VENV) from $(1); this happens once."
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and f"skydog needs Python 3.11 or newer, {sys.executable} is {sys.version.split()[0]}; try make PYTHON=python3.12 $(MAKECMDGOALS)")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip --disable-pip-version-check install --require-hashes -r $(1)
	@$(BIN)/python -m pip --disable-pip-version-check install --no-build-isolation --no-deps -e .
	@touch $@
endef

$(VENV)/run.stamp: locks/run.txt pyproject.toml
	$(call install,locks/run.txt)

$(VENV)/dev.stamp: locks/dev.txt pyproject.toml
	$(call install,locks/dev.txt)
	@touch $(VENV)/run.stamp

$(VENV)-peers/stamp: benchmarks/peers.txt pyproject.toml
	$(PYTHON) -m venv $(VENV)-peers
	$(VENV)-peers/bin/pip --disable-pip-version-check install -q -r benchmarks/peers.txt -e .
	@touch $@

$(VENV)-twin-peers/stamp: benchmarks/twin-peers.txt
	$(PYTHON) -m venv $(VENV)-twin-peers
	$(VENV)-twin-peers/bin/pip --disable-pip-version-check install -q -r benchmarks/twin-peers.txt
	@touch $@
