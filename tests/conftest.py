"""Fixtures that tests of the command line share."""

import pytest


@pytest.fixture
def call(capfd):
    """Run a command in this process: exit code, standard output, standard error."""
    from drivetool.cli import main

    def run(*words):
        with pytest.raises(SystemExit) as left:
            main.app([str(word) for word in words], prog_name="drivetool")
        text = capfd.readouterr()
        return left.value.code or 0, text.out, text.err
    return run
