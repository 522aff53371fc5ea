VENV ?= .venv
PYTHON ?= python3
READY := $(VENV)/.ready

.PHONY: help demo test fuzz crash check clean

help:
	@echo "make demo   install, then measure the capture that comes with the package"
	@echo "make test   install, then run the tests"
	@echo "make fuzz   install, then damage 10,000 captures and 2,000 stored files at random and read them"
	@echo "make crash  kill commands 1,800 times, a batch 40 times, and a season of 300 captures, and look at what is left; takes twenty minutes of processor time or more"
	@echo "make check  what a change must pass: format, lint, types, tests"

$(READY): pyproject.toml constraints.txt
	@test -x $(VENV)/bin/python -a -e $(VENV)/bin/pip || $(PYTHON) -m venv $(VENV) || \
		{ echo "python3 can't make an environment; on Debian and Ubuntu: apt install python3-venv"; exit 1; }
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev,train,bench,raw,view,parquet,cluster]'
	@touch $@

demo: $(READY)
	$(VENV)/bin/photonormal measure demo --out demo-result
	$(VENV)/bin/photonormal score demo demo-result
	@echo "pictures: demo-result/preview.png (photograph, normals, relit, albedo, error), normals.png, mesh.ply"

test: $(READY)
	$(VENV)/bin/python -m pytest -q

fuzz: $(READY)
	$(VENV)/bin/python -m tests.fuzz.stored_files --cases 2000
	$(VENV)/bin/python -m tests.fuzz.captures --cases 10000

crash: $(READY)
	$(VENV)/bin/python -m tests.crash.crash --kills 100
	$(VENV)/bin/python -m tests.crash.batch --kills 40
	$(VENV)/bin/python -m tests.crash.season
	$(VENV)/bin/python -m tests.crash.season --captures 60 --broken 3 --workers 3

check: $(READY)
	VENV=$(VENV) scripts/check

clean:
	rm -rf $(VENV) demo-result
