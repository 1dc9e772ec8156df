"""No page, example or message installs drivetool by its name: no index has it, and anybody may take the name."""

import re

import pytest

from tests.places import ROOT

FILES = ("*.md", "Makefile", "pyproject.toml", ".ci/*", "docs/**/*", "schemas/**/*", "fixtures/**/*.yaml",
         "drivetool/**/*.py")
TEXT = {"", ".md", ".py", ".yml", ".yaml", ".mk", ".smk", ".toml", ".json", ".txt", ".cfg", ".sh"}
BY_NAME = re.compile(
    r"""\b(?:install|add|download|inject|upgrade|uvx|(?:pipx|tool)\s+run)\s+  # pip, pipx, uv, poetry, conda
        (?:-\S+\s+)* ['"]? drivetool (?![\w./*-]|'s)
        |\b(?:pip3?|pipx|uvx?|conda|mamba|poetry)\s .* \s ['"]? drivetool (?![\w/*-]|\.\w)  # behind options
        |\bdrivetool \s* (?:\[[\w,\s-]+\]|[=~<>!]=) \s* [\w.]*  # a requirement, with or without a version
    """, re.VERBOSE | re.IGNORECASE)


def files():
    return sorted({path for pattern in FILES for path in ROOT.glob(pattern)
                   if path.is_file() and path.suffix in TEXT and "__pycache__" not in path.parts})


def test_nothing_installs_it_by_name():
    found = [f"{path.relative_to(ROOT)}:{i}: {line.strip()}" for path in files()
             for i, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1) if BY_NAME.search(line)]
    assert not found
    assert {"README.md", "github.yml", "site.mk", "site.smk", "dask_cluster.py"} <= {path.name for path in files()}


@pytest.mark.parametrize(("line", "is_one"), [
    ("pip install drivetool", True), ("python -m pip install --quiet -U drivetool", True),
    ("uv add drivetool", True), ("Install it with `pip install 'drivetool[site]'`.", True),
    ("pipx run drivetool show x.yaml", True), ("- drivetool==0.2.0", True), ("drivetool[site]>=0.2", True),
    ("drivetool>=0.2", True), ("Then pip install drivetool.", True), ("pip install numpy drivetool", True),
    ("uv pip install --python 3.11 drivetool", True), ("conda install -c conda-forge drivetool", True),
    ("pip wheel DriveTool", True),
    ("pip install .", False), ("pip install '.[site]'", False), ("pip install ./wheels/drivetool-*.whl", False),
    ("pip install drivetool-0.2.0-py3-none-any.whl", False), ("make demo installs drivetool into .venv", False)])
def test_what_is_by_name(line, is_one):
    assert bool(BY_NAME.search(line)) == is_one
