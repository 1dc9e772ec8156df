"""drivetool findings: the registry of codes on the command line."""

import json

import pytest
import yaml

from drivetool.finding_codes import CODES


def test_all_codes_are_listed_as_they_are_registered(call):
    code, out, err = call("findings")
    entries = {e["code"]: e for e in yaml.safe_load(out)["findings"]}
    assert code == 0 and not err and set(entries) == set(CODES)
    assert all(entries[name]["meaning"] == c.meaning and tuple(entries[name]["severities"]) == c.severities
               for name, c in CODES.items())
    assert json.loads(call("findings", "--json")[1]) == yaml.safe_load(out)


def test_one_code_is_printed_in_full(call):
    _, out, _ = call("findings", "trend-alarm")
    assert yaml.safe_load(out)["action"] == CODES["trend-alarm"].action


def test_a_code_of_an_earlier_version_leads_to_the_present_one(call):
    code, out, err = call("findings", "torque-late")
    assert (code, err) == (0, "") and yaml.safe_load(out)["code"] == "torque-shifted"


def test_a_file_with_a_code_of_an_earlier_version_is_printed_with_the_present_one(call, tmp_path):
    path = tmp_path / "old.yaml"
    path.write_text("schema: drivetool/parameters/1\nparameters: {}\nfindings:\n"
                    "- {severity: warning, code: not-settled, text: It did not., evidence: {}, action: ''}\n")
    _, out, err = call("show", str(path))
    assert "not-converged" in out + err and "not-settled" not in out + err


def test_an_unknown_code_is_refused_with_the_nearest(call):
    code, out, err = call("findings", "trend-alarms")
    assert code == 2 and not out and "Did you mean 'trend-alarm'?" in err


@pytest.mark.parametrize("words, said", [((), "drivetool findings CODE gives"), (("small-change",), "what to do")])
def test_a_terminal_gets_a_table(call, words, said):
    code, out, _ = call("findings", *words, terminal=True)
    assert code == 0 and said in out
