"""One contract over every format of a log: what a reader gives, and how it refuses what it cannot read."""

import numpy as np
import pytest

from drivetool.errors import BadRecording, DriveToolError
from drivetool.logs.door.build import open_experiment
from drivetool.logs.formats.read import READERS, read_recording
from tests.logs.test_readers import data, write_mcap, write_parquet

# A new format brings the function that writes a table of columns, 0.4 ms a row, with units.
WRITERS = {".parquet": write_parquet, ".mcap": write_mcap}
every = pytest.mark.parametrize("suffix", sorted(READERS))


def test_every_format_has_a_writer():
    assert set(WRITERS) == set(READERS)


@every
def test_values_units_and_the_clock_are_those_that_were_written(tmp_path, suffix):
    columns = data()
    found = open_experiment(WRITERS[suffix](tmp_path / f"a{suffix}", columns))
    assert found.step == 0.0004 and found.torque_unit == "Nm" and found.findings == ()
    assert set(found.signals) == set(columns)
    for role, values in columns.items():
        assert found.signals[role].tobytes() == values.tobytes() and not found.signals[role].flags.writeable


@every
def test_equal_bytes_have_one_hash_and_other_bytes_another(tmp_path, suffix):
    one, same, other = (open_experiment(WRITERS[suffix](tmp_path / f"{name}{suffix}", data(seed=seed)))
                        for name, seed in (("a", 3), ("b", 3), ("c", 4)))
    assert one.sha256 == same.sha256 != other.sha256 and (one.name, same.name) == (f"a{suffix}", f"b{suffix}")


@every
def test_names_of_channels_that_are_no_role_need_a_map(tmp_path, suffix):
    path = WRITERS[suffix](tmp_path / f"a{suffix}", {"iq": np.ones(50), "n": np.arange(50.0)})
    found = read_recording(path, choose=lambda names: names)
    assert {name.rpartition(".")[2] for name in found.channels} == {"iq", "n"}
    with pytest.raises(BadRecording, match=r"wanted channels named like the roles .* \(available: .*iq, .*n\)"):
        open_experiment(path)


@every
@pytest.mark.parametrize("content", [b"", b"no log at all", bytes(range(256)) * 20], ids=["empty", "text", "noise"])
def test_what_is_no_log_is_refused_in_one_sentence(tmp_path, suffix, content):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(BadRecording, match=r"^wanted .*; found .*\. [A-Z].*\.$"):
        read_recording(path)


@every
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_of_a_truncated_log_a_part_is_used_with_a_finding_or_none(tmp_path, suffix, share):
    columns = data()
    path = WRITERS[suffix](tmp_path / f"a{suffix}", columns)
    path.write_bytes(path.read_bytes()[:int(share * path.stat().st_size)])
    try:
        found = open_experiment(path)
    except DriveToolError as refused:
        assert str(refused).startswith("wanted ")
        return
    assert "log-damaged" in {f.code for f in found.findings}
    for role, values in columns.items():
        assert found.signals[role].tobytes() == values[:found.size].tobytes()
