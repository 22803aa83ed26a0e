# What can be done here; `make` alone lists it. Needs Python 3.10 to 3.13 and nothing else.

PYTHON ?= python3
# An extra address for packages, such as the one pytorch.org's install page shows for CPU-only torch:
TORCH_INDEX ?=
# More options for JupyterLab, such as --no-browser --port=8890:
LAB ?=

VENV := .venv
IN := $(VENV)/bin/python
READY := $(VENV)/.ready

.DEFAULT_GOAL := help
.PHONY: help lab quick test tour notebooks examples sheets docs bench fuzz pins clean

help: ## list the commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

lab: $(READY) ## open JupyterLab on the tour
	$(IN) -m jupyter lab notebooks/00_tour.ipynb $(LAB)

quick: $(READY) ## lint and the fast tests, in two minutes
	$(IN) -m ruff check .
	$(IN) -m pytest -q -m "not slow and not browser and not nightly"

test: $(READY) ## lint, unit tests, every notebook, then the browser
	$(IN) -m ruff check .
	$(IN) -m pytest -q -m "not browser and not nightly"
	$(IN) tools/check_notebooks.py
	$(IN) tools/try_notebooks.py
	$(IN) -m pytest -q -m browser tests

tour: $(READY) ## run the tour without a browser; its motion (BVH) and page (HTML) land in out/
	@$(IN) tools/tour.py

notebooks: $(READY) ## execute all notebooks in place (NB=file for one)
	@$(IN) tools/run_notebooks.py $(NB)

examples: $(READY) ## make data/actor again, and the fingerprint of what the performer makes
	$(IN) tools/make_examples.py
	$(IN) tools/make_fingerprint.py

sheets: $(READY) ## draw every content in every style, and every creature, into out/sheets/
	$(IN) tools/contact_sheets.py

docs: $(READY) ## write docs/*.md from the code
	$(IN) tools/make_docs.py

bench: $(READY) ## measure NAME=io|actor|arena|diffusion|few_shot|style_erd into results/ (ONLY="a b": these figures)
	$(IN) -m motionkit.benchmarks $(NAME) $(if $(ONLY),--only $(ONLY)) $(if $(DIRTY),--dirty)

fuzz: $(READY) ## nightly: the BVH reader against 20,000 broken files
	MOTIONKIT_FUZZ=20000 $(IN) -m pytest -q tests/test_bvh_fuzz.py

pins: $(READY) ## write constraints.txt from pyproject.toml (UPGRADE=--upgrade for newer versions)
	$(IN) -m pip install -q uv
	$(IN) -m uv pip compile --quiet --universal --python-version 3.10 --extra lab --extra test --no-annotate \
		--custom-compile-command "make pins   (every version that -e .[lab,test] brings in, Python 3.10 to 3.13)" \
		pyproject.toml -o constraints.txt $(UPGRADE)

clean: ## remove what runs leave behind (the virtual environment stays: rm -rf .venv)
	rm -rf out build motionkit.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -path ./$(VENV) -prune -o \( -name __pycache__ -o -name .ipynb_checkpoints \) -type d -exec rm -rf {} +

$(READY): pyproject.toml constraints.txt tools/make_venv.py
	@$(PYTHON) tools/make_venv.py $(VENV) $(TORCH_INDEX)
	@touch $@
