"""The checker of the pages' examples sees what changed, and nothing else."""

import pytest

from docs import check_examples
from docs.check_examples import differs


@pytest.mark.parametrize("expected, printed", [
    ("gap 0.0750 rad\n", "gap   0.0751 rad"), ("a ... c", "a b b c"), ("...", "x y"), ("a\n...\n", "a"), ("", ""),
    ("... b c ... d", "a b x b c d"), ("1.50e-3", "1.51e-3"), ("-54.9..85.4", "-54.9..85.5")])
def test_equal_but_for_columns_last_digits_and_ellipsis(expected, printed):
    assert not differs(expected, printed)


@pytest.mark.parametrize("expected, printed, message", [
    ("gap 0.0750 rad", "gap 0.0753 rad", "expected `0.0750 rad`; printed `0.0753 rad`"),
    ("n 12", "n 13", "12"), ("a ... c", "a b d", "c"), ("a", "a b", "the end"), ("a b", "a", "nothing more"),
    ("a ...", "b a", "printed `b a`"), ("", "x", "the end"), ("... x", "y", "x"), ("1.5e-3", "1.5e-4", "1.5e-3"),
    ("1.5", "-1.5", "1.5")])
def test_what_changed_is_reported(expected, printed, message):
    assert message in differs(expected, printed)


PAGE = """text
```console
$ printf 'one 1.00\\n'; \\
  echo two
one 1.00
two
$ false
$ echo $?
1
$ test -t 1 && cat made
...
```
"""


def test_a_block_runs_in_one_folder_on_a_terminal(tmp_path):
    (tmp_path / "made").write_text("by the page before\n")
    block, = check_examples.blocks_of("page.md", PAGE)
    assert (block.line, [command for command, _ in block.steps()]) == (2, [
        "printf 'one 1.00\\n'; echo two", "false", "echo $?", "test -t 1 && cat made"])
    assert check_examples.faults_of(block, str(tmp_path)) == ([], "\n".join(PAGE.splitlines()[2:-1]).replace(
        "\\\n  ", "") + "\n")
    block, = check_examples.blocks_of("page.md", PAGE.replace("$ echo $?\n1\n", "").replace("1.00", "1.00 3", 1))
    faults, right = check_examples.faults_of(block, str(tmp_path))
    assert len(faults) == 2 and "exit code 1" in faults[1] and "one 1.00 3\ntwo\n" in right


@pytest.mark.parametrize("line, message", [
    ("drivetool greybox a.mcap --parms b.yaml", "--parms"), ("drivetool gerybox a.mcap", "no step gerybox"),
    ("drivetool show a.yaml | drivetool greybox a.mcap --criterion best", "best")])
def test_a_command_that_does_not_run_names_what_exists(line, message):
    block = check_examples.Block("page.md", 1, "sh", f"A=b\n{line}  # comment\n")
    fault, = check_examples.wrong_usage(block)
    assert message in fault
    right = check_examples.Block("page.md", 1, "sh", "drivetool greybox a.mcap --set motor.inertia=2 > b.yaml\n")
    assert check_examples.wrong_usage(right) == []


def test_a_file_in_a_list_must_be_one_that_the_tool_takes(tmp_path):
    page = "1. A:\n\n   ```yaml\n   schema: drivetool/parameters/1\n   parameters: {motor.inertia: 2}\n   ```\n"
    block, = check_examples.blocks_of("page.md", page)
    assert block.kind == "yaml" and check_examples.refused(block, str(tmp_path)) == []
    block, = check_examples.blocks_of("page.md", page.replace("motor.inertia", "motor.inerta"))
    fault, = check_examples.refused(block, str(tmp_path))
    assert "motor.inerta" in fault
