"""A channel that is no shaft torque is refused by every step that would fit it, in one sentence."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from drivetool.identify.shaft_torque import check_shaft_torque
from drivetool.identify.shaft_torque.channel import SHAFT_SIGN_SIGNIFICANCE, SHAFT_TORQUE_BLOCKS, shaft_torque_share
from drivetool.logs.door import open_experiment
from tests.places import FIXTURES

FOLDER = FIXTURES / "light"
START = ("--drive", "two-mass", "--set", "motor.inertia=4", "--set", "load.inertia=0.6", "--set",
         "shaft.stiffness=3500", "--set", "shaft.half_gap=0.1")


def altered(folder, name, **factors):
    """A recording of the light rig with some channels multiplied."""
    table = pq.read_table(FOLDER / f"{name}.parquet")
    for role, factor in factors.items():
        i = table.column_names.index(role)
        table = table.set_column(i, table.schema.field(i), pa.array(factor * np.asarray(table[role])))
    pq.write_table(table, folder / f"{name}.parquet")
    return folder / f"{name}.parquet"


@pytest.mark.parametrize("step, name", [("steady", "steady"), ("blackbox", "steps"), ("greybox", "steps"),
                                        ("backlash", "gap")])
@pytest.mark.parametrize("factor, words", [(0.0, "zeros throughout"), (-1.0, "sign: -1")])
def test_zeros_and_a_turned_sign_are_refused(call, tmp_path, step, name, factor, words):
    log = altered(tmp_path, name, shaft_torque=factor)
    code, _, err = call(step, log, *START, "--out", tmp_path / "out.yaml")
    assert code not in (0, 3), err
    assert words in err and "shaft_torque" in err and name in err and "Traceback" not in err
    assert not (tmp_path / "out.yaml").exists()


def test_turned_round_in_the_map_it_is_right_again(call, tmp_path):
    log = altered(tmp_path, "steady", shaft_torque=-1.0)
    (tmp_path / "map.yaml").write_text(
        "schema: drivetool/channel-map/1\nroles:\n  motor_torque: {channel: motor_torque}\n"
        "  motor_speed: {channel: motor_speed}\n  shaft_torque: {channel: shaft_torque, sign: -1}\n")
    code, _, err = call("steady", log, "--map", tmp_path / "map.yaml", "--out", tmp_path / "out.yaml")
    assert code == 0, err


def test_steady_needs_a_motor_torque(call, tmp_path):
    code, _, err = call("steady", altered(tmp_path, "steady", motor_torque=0.0), "--drive", "two-mass")
    assert code != 0 and "coasts down without torque" in err and "check the channel of its torque" in err


@pytest.mark.parametrize("name", ["steady", "steps", "gap", "gap_holdout"])
def test_right_recordings_pass(name):
    from drivetool.drive import one_body, two_mass

    record = open_experiment(FOLDER / f"{name}.parquet")
    check_shaft_torque([record], two_mass())
    check_shaft_torque([record], one_body())
    shares = [shaft_torque_share(record, "shaft_torque", count) for count in SHAFT_TORQUE_BLOCKS]
    # Turned round, each would be refused.
    assert all(share > SHAFT_SIGN_SIGNIFICANCE * std > 0.0 for share, std in shares)
    # The load's part of the whole inertia, as far as the swing lets it be seen.
    assert shares[1][0] == pytest.approx(0.646 / (0.646 + 4.78), rel=0.3)
