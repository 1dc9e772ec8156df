"""The comparison finds what it must, on stored toy results; what cannot be compared is said in one sentence."""

import io
import platform
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from tests.golden import compare, environment, masks, places, sentences, surroundings, tasks
from tests.golden.case import Case
from tests.golden.run import Result, Step, run, run_all

YAML = b"""schema: drivetool/parameters/1
tool: {name: drivetool, version: 0.2.0}
inputs: {steps.parquet: SHA}
parameters:
  motor.inertia: {value: 0.5929252636, unit: kg m^2, status: fitted}
  motor.coulomb: {value: 0.0, unit: Nm, status: held}
findings:
- {code: gap-seen, text: The half gap is 0.10 mrad in 3 runs.}
"""
CASE = Case("toy", "toys", {}, ("drivetool greybox",))


def table(values, kind=None, **more):
    sink = io.BytesIO()
    pq.write_table(pa.table({"time": [0.0, 0.1, 0.2], "speed": pa.array(values, kind), **more}), sink)
    return sink.getvalue()


def picture(shade=255):
    pixels = np.full((4, 6, 3), 255, np.uint8)
    pixels[2, 3] = shade
    sink = io.BytesIO()
    Image.fromarray(pixels).save(sink, "png")
    return sink.getvalue()


MANIFEST = b"""{"schema":"manifest/1"}
{"output":"a.yaml","told":{"seconds":1.5},"seconds":2.5,"peak_memory_mb":null}
{"output":"b.yaml","told":null,"seconds":0.5,"peak_memory_mb":120.5}
"""
FILES = {"fit.yaml": YAML, "curves.parquet": table([1.0, 2.0, 3.0]), "p1/fit.png": picture(),
         "summary.csv": b"recording,value,seconds,peak_memory_mb\na,1.5,2.0,100\n", "manifest.jsonl": MANIFEST,
         "verdicts.xml": b'<failure message="found 0.10 Nm in the file"/>\n'}


def result(files=FILES, exit_code=0, stdout=b"half gap 0.10 mrad\n"):
    contents = {places.digest(data): data for data in (*files.values(), stdout)}
    step = Step("drivetool greybox", exit_code, places.digest(stdout),
                {path: places.digest(data) for path, data in files.items()})
    return Result((step,), contents)


def compared(new, tmp_path, old=None, known=None):
    """The differences of two stored results, as (what, lines)."""
    for side, each in (("old", old or result()), ("new", new)):
        each.write(tmp_path / side / f"{CASE.key}.zip")
    found = compare.compare([CASE], tmp_path / "old", tmp_path / "new", known or masks.Masks())
    files = {path for each in (old or result(), new) for path in each.steps[0].files}
    assert (found.cases, found.commands, found.files) == (1, 1, len(files))
    return [(each.what, " ".join(each.lines)) for each in found.differences]


def changed(path, old, new):
    """The toy result with a text of one file replaced."""
    assert old in FILES[path]
    return result(FILES | {path: FILES[path].replace(old, new)})


def test_equal_results_do_not_differ(tmp_path):
    assert compared(result(), tmp_path) == []


def test_a_change_of_1e_10_is_found(tmp_path):
    (what, lines), = compared(changed("fit.yaml", b"0.5929252636", b"0.59292526365929"), tmp_path)
    assert what == "fit.yaml"
    assert ".parameters.motor.inertia.value: 0.5929252636 before, 0.59292526365929 now (by 1e-10 of it)" in lines
    (what, lines), = compared(result(FILES | {"curves.parquet": table([1.0, 2.0 * (1 + 1e-10), 3.0])}), tmp_path)
    assert what == "curves.parquet" and "speed: 1 rows, the first of them 1: 2.0 before" in lines
    (what, lines), = compared(result(stdout=b"half gap 0.10000000001 mrad\n"), tmp_path)
    assert what == "stdout" and "0.10000000001" in lines


def test_a_zero_of_the_other_sign_is_found(tmp_path):
    (_, lines), = compared(changed("fit.yaml", b"value: 0.0", b"value: -0.0"), tmp_path)
    assert "0.0 before, -0.0 now" in lines
    zeros = [result(FILES | {"curves.parquet": table([zero, 2.0, 3.0])}) for zero in (0.0, -0.0)]
    assert compared(zeros[1], tmp_path, zeros[0]) == [
        ("curves.parquet", "speed: 1 rows, the first of them 0: 0.0 before, -0.0 now")]
    (_, lines), = compared(changed("fit.yaml", b"0.10 mrad", b"-0.10 mrad"), tmp_path)
    assert "-0.10 mrad" in lines
    assert not sentences.same_sentence("a gap of 0.0 rad", "a gap of -0.0 rad")


def test_a_swapped_order_of_keys_is_found(tmp_path):
    (what, lines), = compared(changed("fit.yaml", b"value: 0.0, unit: Nm", b"unit: Nm, value: 0.0"), tmp_path)
    assert what == "fit.yaml" and ".parameters.motor.coulomb: order of keys, value before, unit now" in lines


def test_another_layout_of_equal_values_is_found(tmp_path):
    (what, lines), = compared(changed("fit.yaml", b"kg m^2", b"'kg m^2'"), tmp_path)
    assert what == "fit.yaml" and "'kg m^2'" in lines
    (what, lines), = compared(changed("fit.yaml", b"value: 0.0,", b"value: 0.00,"), tmp_path)
    assert "0.0 before, 0.00 now" in lines


def test_missing_files_exit_codes_and_pixels_are_found(tmp_path):
    fewer = {path: data for path, data in FILES.items() if path != "fit.yaml"}
    assert compared(result(fewer), tmp_path) == [("fit.yaml", "written before, not now")]
    assert compared(result(), tmp_path, result(fewer)) == [("fit.yaml", "not written before, written now")]
    assert compared(result(exit_code=3), tmp_path) == [("exit code", "0 before, 3 now")]
    (what, lines), = compared(result(FILES | {"p1/fit.png": picture(254)}), tmp_path)
    assert what == "p1/fit.png" and "1 pixels differ, the first at (3, 2)" in lines


def test_costs_and_numbers_inside_sentences_are_masked(tmp_path):
    known = masks.Masks()
    assert compared(changed("summary.csv", b"2.0,100", b"9.0,300"), tmp_path, known=known) == []
    assert compared(changed("fit.yaml", b"0.10 mrad", b"0.1 mrad"), tmp_path, known=known) == []
    assert +known.used == {"cost": 2, "number": 1}
    (what, _), = compared(changed("summary.csv", b"a,1.5", b"a,1.6"), tmp_path)
    assert what == "summary.csv"
    (_, lines), = compared(changed("fit.yaml", b"0.10 mrad", b"0.11 mrad"), tmp_path)
    assert "0.11 mrad" in lines


@pytest.mark.parametrize(("path", "old", "new"), [
    ("summary.csv", b"seconds,peak_memory_mb", b"peak_memory_mb,seconds"), ("summary.csv", b"2.0,100", b"2,100"),
    ("summary.csv", b"2.0,100", b",100"), ("summary.csv", b"2.0,100", b'"2.0",100'),
    ("summary.csv", b"2.0,", b"-2.0,"), ("summary.csv", b"100\n", b"100\r\n"), ("summary.csv", b"100\n", b"100"),
    ("summary.csv", b",seconds", b',"seconds"'), ("summary.csv", b"1.5", b'"1.5"'),
    ("manifest.jsonl", b'{"seconds":1.5}', b'{"seconds":1.6}'), ("manifest.jsonl", b"null}", b"1.5}"),
    ("manifest.jsonl", b'"told":null,"seconds":0.5', b'"seconds":0.5,"told":null'),
    ("manifest.jsonl", b'"seconds":2.5,', b""), ("manifest.jsonl", b'"seconds":2.5', b'"seconds": 2.5'),
    ("manifest.jsonl", b'"seconds":2.5', b'"seconds":"2.5"'), ("manifest.jsonl", b'"seconds":2.5', b'"seconds":2')])
def test_a_cost_hides_its_value_and_nothing_else(tmp_path, path, old, new):
    (what, _), = compared(changed(path, old, new), tmp_path)
    assert what == path


def test_a_manifest_may_have_other_costs_and_other_lines_below_its_first(tmp_path):
    first, one, other = MANIFEST.splitlines(keepends=True)
    costs = one.replace(b"2.5", b"7.125")
    assert compared(result(FILES | {"manifest.jsonl": first + other + costs}), tmp_path) == []
    assert compared(result(FILES | {"manifest.jsonl": one + first + other}), tmp_path)


SUMMARY = {"seconds": [1.0, None, 2.0], "peak_memory_mb": [1.0, 2.0, 3.0]}


def test_a_summary_as_parquet_hides_what_costs_and_nothing_else(tmp_path):
    values = [1.0, 0.0, float("nan")]
    other_nan, = struct.unpack("<d", struct.pack("<Q", 0x7FF8000000000001))

    def differ(values=values, kind=None, name="summary.parquet", **more):
        sides = [{name: table([1.0, 0.0, float("nan")], **SUMMARY)}, {name: table(values, kind, **more)}]
        return " ".join(lines for _, lines in compared(result(sides[1]), tmp_path, result(sides[0])))

    spent = {"seconds": [9.0, None, 8.0], "peak_memory_mb": [9.0, 9.0, 9.0]}
    assert differ(**spent) == ""
    assert "seconds: 1 rows" in differ(**spent | {"seconds": [9.0, 7.0, 8.0]})
    assert "speed: 1 rows, the first of them 1: 0.0 before, -0.0 now" in differ([1.0, -0.0, float("nan")], **spent)
    assert "speed: 1 rows, the first of them 2" in differ([1.0, 0.0, other_nan], **spent)
    assert "types" in differ(**spent | {"seconds": pa.array([9.0, None, 8.0], pa.float32())})
    assert "columns" in differ(**dict(reversed(spent.items())))
    assert "columns" in differ(seconds=spent["seconds"])
    assert "types" in differ(**spent | {"seconds": pa.chunked_array([[9, None, 8]])})
    assert "seconds: 2 rows" in differ(name="curves.parquet", **spent)


def test_only_prose_may_have_numbers_written_otherwise(tmp_path):
    for path, old, new in (("summary.csv", b"1.5", b"1.50"), ("verdicts.xml", b"0.10", b"0.1")):
        (what, _), = compared(changed(path, old, new), tmp_path)
        assert what == path
    prose, row = "The half gap is {} rad\nin 3 runs.\n", "value   unit\n────────────\n{} rad/s  \n"
    for text, same in ((prose, True), (row, False), ("a  {} rad\n", False), ("| a | {} rad |\n", False),
                       ("{}\n", False), ("<p>a {} rad</p>\n", False), ("value: {}\ntext: a {} b\n", False),
                       ("text: a gap of {} rad\n", True), ("a file logs/{}.yaml\n", False)):
        old, new = (result(stdout=text.replace("{}", number).encode()) for number in ("1.50", "1.5"))
        assert (compared(new, tmp_path, old) == []) is same, text
    old, new = (f"a number of {number} rad" for number in ("0.1000000000000000055", "0.1"))
    assert not sentences.same_sentence(old, new)


def test_lines_break_elsewhere_only_around_what_was_replaced(tmp_path):
    known = masks.Masks(renamed={"belt": "transmission"})
    paragraph = "The belt is wide\nin 3 runs."
    text = "spring:\n  meaning: The belt of\n    3 runs\nother: The spring of\n  3 runs\nend: {a: belt}\n"
    for old, new, same in (
            (paragraph, "The transmission is\nwide in 3 runs.", True), (paragraph, paragraph, False),
            (f"{paragraph}\n\nA spring\nhere.", "The transmission is\nwide in 3 runs.\n\nA spring here.", False),
            ("belt   1.5\nnut   1.5", "transmission 1.5\nnut   1.5", True),
            ("belt   1.5 mm", "transmission 1.50 mm", False),
            ("belt   1.5\nnut   1.5", "transmission 1.5\nnut  1.5", False),
            (text, text.replace("belt of\n    3", "transmission\n    of 3").replace("belt", "transmission"), True),
            (text, text.replace("belt", "transmission").replace("spring of\n  3", "spring\n  of 3"), False)):
        sides = [result(stdout=each.encode()) for each in (old, new)]
        assert (compared(sides[1], tmp_path, sides[0], known) == []) is same, new


def test_quotes_and_keys_of_tasks_may_change_only_with_what_was_replaced(tmp_path):
    known = masks.Masks(renamed={"{1*} is a gap: it": "{1*} is a gap and"})
    before, after = b"text: 'One is a gap: it opens'\nend: 1.0\n", b"text: One is a gap and opens\nend: 1.0\n"
    for old, new, same in ((before, after, True), (after, b"text: 'One is a gap and opens'\nend: 1.0\n", False),
                           (before, after.replace(b"1.0", b"'1.0'"), False)):
        assert (compared(result({"fit.yaml": new}), tmp_path, result({"fit.yaml": old}), known) == []) is same
    line = b'{"schema":"manifest/1"}\n{"output":"b.yaml","key":"%s"}\n'
    hidden = masks.Masks(renamed={"gap": "play"})
    for text, same in ((b"a gap", False), (b"a play", True)):
        sides = [result({"a.txt": each, "manifest.jsonl": line % key}, stdout=b"")
                 for each, key in ((b"a gap", b"a" * 64), (text, b"b" * 64))]
        assert (compared(sides[1], tmp_path, sides[0], hidden if same else None) == []) is same


def test_a_rename_that_was_not_carried_out_is_found(tmp_path):
    files = {"fit.yaml": YAML, "codes.parquet": table(["gap-seen", "", ""])}
    known = masks.Masks(renamed={"gap-seen": "backlash-is-seen"})
    assert [what for what, _ in compared(result(files), tmp_path, result(files), known)] == [
        "fit.yaml", "codes.parquet"]
    done = {"fit.yaml": YAML.replace(b"gap-seen", b"backlash-is-seen"),
            "codes.parquet": table(["backlash-is-seen", "", ""])}
    assert compared(result(done), tmp_path, result(files), known) == []


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """The folder in which results are kept, of cases that run with few variables."""
    variables = {"PATH": "/usr/bin:/bin", "TMPDIR": str(tmp_path / "tmp")}
    monkeypatch.setattr(environment, "variables", lambda _: variables)
    monkeypatch.setenv("DRIVETOOL_GOLDEN", str(tmp_path))
    return tmp_path


@pytest.fixture
def toys(kept, monkeypatch):
    """Two toy results and two toy trees, and the comparison of them."""
    monkeypatch.setattr(environment, "tree", lambda commit: kept / "trees" / commit)
    monkeypatch.setattr(tasks, "version", lambda _: "0.2.0")

    def compared_trees(new=None, schema='{"title": "A fit"}'):
        for commit, each, text in (("old", result(), '{"title": "A fit"}'), ("new", new or result(), schema)):
            each.write(kept / commit / f"{CASE.key}.zip")
            place = kept / "trees" / commit / "schemas" / "fit.json"
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text)
        return tasks.report("old", "new", [CASE], kept / "old", kept / "new")

    return compared_trees


def test_what_differs_in_a_result_or_a_schema_is_reported_and_gives_exit_code_1(toys, tmp_path, capsys):
    assert toys() == 0
    said = capsys.readouterr().out
    assert "1 cases, 1 commands, 6 files, 1 schemas; 0 differences" in said
    assert toys(changed("fit.yaml", b"0.5929252636", b"0.7")) == 1
    said = capsys.readouterr().out
    assert "toy: drivetool greybox\n  fit.yaml\n    .parameters.motor.inertia.value: 0.5929252636 before" in said
    assert "1 differences" in said
    assert toys(schema='{"title": "Another"}') == 1
    said = capsys.readouterr().out
    assert "schemas: fit.json\n  content\n    .title: A fit before, Another now" in said and "1 differences" in said
    assert (tmp_path / "report.txt").read_text() in said


def test_a_schema_that_one_tree_lacks_is_reported(toys, tmp_path, capsys):
    toys()
    (tmp_path / "trees" / "new" / "schemas" / "more.json").write_text("{}")
    assert toys() == 1
    assert "schemas: more.json\n  file\n    missing before" in capsys.readouterr().out


def test_version_hashes_and_renamed_codes_are_masked_and_counted(tmp_path):
    sides = []
    for record, code, version in ((b"one", b"gap-seen", b"0.2.0"), (b"two", b"backlash-is-seen", b"0.3.0")):
        text = YAML.replace(b"SHA", places.digest(record).encode()).replace(b"gap-seen", code)
        sides.append(result({"steps.txt": record, "fit.yaml": text.replace(b"0.2.0", version)}))
    known = masks.Masks(("0.2.0", "0.3.0"), {"gap-seen": "backlash-is-seen"})
    # What an earlier file has is a difference by itself, and only there.
    assert compared(sides[1], tmp_path, sides[0], known) == [("steps.txt", "-one +two")]
    assert known.used["version"] and known.used["renamed: gap-seen -> backlash-is-seen"]
    assert known.used["hash of an earlier file"] == 1
    assert {what for what, _ in compared(sides[1], tmp_path, sides[0])} == {"steps.txt", "fit.yaml"}


def test_a_renamed_code_is_no_part_of_a_longer_one():
    known = masks.Masks(renamed={"gap": "play"})
    assert known.apply("gap, gap-seen, gap. no-gap") == "play, gap-seen, play. no-gap"
    assert masks.Masks(renamed={"The gap\nis wide.": "It is wide."}).apply("The gap\n  is wide.") == "It is wide."


def test_the_variable_parts_of_a_renamed_sentence_stay_as_they_are():
    known = masks.Masks(renamed={"{1} is given by {2*} of 7": "{2*} of 7 identify {1}", "no {1}": "not one {1}"})
    text = known.apply("tip.inertia is\n  given by 3.5 s and\nmore of 7.")
    assert text == "3.5 s and\nmore of 7 identify tip.inertia."
    assert known.apply("no 0.7, no-one") == "not one 0.7, no-one"
    assert known.apply("motor.inertia is given") == "motor.inertia is given"


def test_a_case_runs_and_keeps_what_each_command_gave(tmp_path):
    commands = ("echo 1 >a; echo 2 >b; echo out; false", "echo $?; rm a; echo 3 >b")
    found = run(replace(CASE, commands=commands), tmp_path, {"PATH": "/usr/bin:/bin"})
    first, second = found.steps
    assert (first.exit, found.contents[first.stdout], sorted(first.files)) == (1, b"out\n", ["a", "b"])
    assert (second.exit, found.contents[second.stdout]) == (0, b"1\n")
    assert (list(second.files), second.gone) == (["b"], ["a"])
    found.write(tmp_path / "kept.zip")
    assert Result.read(tmp_path / "kept.zip") == found


@pytest.mark.usefixtures("kept")
def test_a_case_that_has_a_result_is_not_run_again():
    case = replace(CASE, commands=("date +%N",))
    place = run_all([case], "0" * 40)
    before = Result.read(place / f"{case.key}.zip")
    assert run_all([case], "0" * 40) == place and Result.read(place / f"{case.key}.zip") == before
    run_all([case], "0" * 40, again=True)
    assert Result.read(place / f"{case.key}.zip").contents != before.contents


@pytest.mark.parametrize("command", ["sleep 60", "kill -9 $$", "bash -c 'kill -9 $$'; exit $?"])
def test_a_case_that_was_stopped_is_not_kept_and_is_a_difference(kept, monkeypatch, command):
    monkeypatch.setattr("tests.golden.run.LIMIT", 0.3)
    case = replace(CASE, commands=(command,))
    for place in (kept / "old", kept / "new"):
        result().write(place / f"{case.key}.zip")
    place = run_all([case], "0" * 40, again=True, place=kept / "new")
    assert not list(place.glob("*.zip"))
    (found,) = compare.compare([case], kept / "old", place, masks.Masks()).differences
    assert "no result\n    a command did not end by itself now; the case is run again" in str(found)


@pytest.mark.parametrize(("name", "other"), [("FIXED", {"TZ": "CET"}), ("WRAPPER", "#!/bin/sh\n"),
                                             ("processor", lambda: "another")])
def test_results_are_kept_by_environment_and_processor(monkeypatch, name, other):
    before = places.results("0" * 40)
    assert places.results("0" * 40) == before
    monkeypatch.setattr(f"tests.golden.surroundings.{name}", other)
    assert places.results("0" * 40) != before


def test_the_processor_has_a_name_without_numba(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    monkeypatch.setattr(surroundings, "CPUINFO", tmp_path / "cpuinfo")
    surroundings.CPUINFO.write_text("processor : 0\nmodel name\t: A 9000: fast\n")
    assert surroundings.processor().endswith(" A 9000: fast")
    surroundings.CPUINFO.unlink()
    assert surroundings.processor().startswith(platform.machine())


@pytest.fixture
def repository(tmp_path):
    """A repository of one commit."""
    for words in (("init", "-q"), ("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "--allow-empty",
                                   "-m", "first")):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    return tmp_path


def test_an_unknown_base_and_a_dirty_tree_get_one_sentence(repository):
    head = places.head_of_clean_tree(repository)
    assert places.commit_of(head[:8], repository) == head
    with pytest.raises(SystemExit, match=r"^BASE nowhere is no commit of this repository\.$"):
        places.commit_of("nowhere", repository)
    (repository / "new").write_text("a")
    with pytest.raises(SystemExit, match=r"^The working tree differs from its commit: .*\.$"):
        places.head_of_clean_tree(repository)


def test_other_library_versions_get_one_sentence():
    wanted = environment.pinned()
    environment.check_versions(wanted, dict(wanted))
    with pytest.raises(SystemExit, match=r"^1 libraries are not of the lock, the first of them numpy: wanted "):
        environment.check_versions(wanted, wanted | {"numpy": "1.0"})
    with pytest.raises(SystemExit, match="the first of them extra: wanted none, found 1"):
        environment.check_versions(wanted, wanted | {"extra": "1"})
    with pytest.raises(SystemExit, match="the first of them scipy"):
        environment.check_versions(wanted, {name: v for name, v in wanted.items() if name != "scipy"})


def test_base_is_a_commit_and_the_cases_are_chosen_by_name():
    assert len(places.BASE.read_text().strip()) == 40
    renamed = masks.renamed()
    assert all(old != new for old, new in renamed.items())
    cases = [replace(CASE, name=name) for name in ("docs-a", "docs-b", "site")]
    assert [each.name for each in tasks.chosen(cases, ["docs-*"])] == ["docs-a", "docs-b"]
    assert tasks.chosen(cases, []) == cases


def test_the_comparison_does_not_import_the_product():
    paths = sorted(Path(compare.__file__).parent.glob("*.py"))
    assert {"compare.py", "masks.py", "values.py"} <= {path.name for path in paths}
    for path in paths:
        assert not any(line.split()[:1] in (["import"], ["from"]) and "drivetool" in line.split()[1]
                       for line in path.read_text().splitlines() if line.split()), path.name
