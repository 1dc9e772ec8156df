"""The joint covariance of several parameter files."""

import numpy as np
import pytest
import yaml

from drivetool.files.yaml.parameter_file import load_parameters


def written(tmp_path, *contents):
    paths = []
    for i, (values, covariance) in enumerate(contents):
        content = {"schema": "drivetool/parameters/1", "parameters": values}
        if covariance is not None:
            content["covariance"] = {"names": covariance[0], "matrix": covariance[1]}
        paths.append(tmp_path / f"{i}.yaml")
        paths[-1].write_text(yaml.safe_dump(content))
    return load_parameters(paths)


def entry(value, unit, **more):
    return {"value": value, "unit": unit, **more}


STEADY = ({"motor.viscous": entry(0.1, "Nm s/rad", std=0.01), "motor.idle_torque": entry(5.0, "Nm", std=0.1)},
          (["motor.viscous", "motor.idle_torque"], [[1e-4, -2e-4], [-2e-4, 1e-2]]))


def test_two_files_of_different_values_know_both(tmp_path):
    shape = ({"motor.inertia": entry(2000.0, "g m^2", std=20.0)}, (["motor.inertia"], [[400.0]]))
    found = written(tmp_path, STEADY, shape)
    found = found.covariance(found.stated().start)
    assert found.names == ("motor.viscous", "motor.idle_torque", "motor.inertia")
    assert found.matrix == pytest.approx(np.array([[1e-4, -2e-4, 0], [-2e-4, 1e-2, 0], [0, 0, 4e-4]]))


def test_a_value_that_a_later_file_carries_on_is_as_well_known_as_before(tmp_path):
    later = ({"motor.viscous": entry(0.1, "Nm s/rad"), "motor.idle_torque": entry(5.0, "Nm")}, None)
    found = written(tmp_path, STEADY, later)
    found = found.covariance(found.stated().start)
    assert found.names == tuple(STEADY[1][0])
    assert found.matrix == pytest.approx(np.array(STEADY[1][1]))


def test_standard_deviations_of_a_file_by_hand_are_uncorrelated(tmp_path):
    """20 g m^2 of a data sheet are 0.02 kg m^2; a value without a deviation counts as known."""
    sheet = ({"motor.inertia": entry(2000.0, "g m^2", std=20.0), "load.inertia": entry(3.0, "kg m^2")}, None)
    found = written(tmp_path, STEADY, sheet)
    found = found.covariance(found.stated().start)
    assert found.names == ("motor.viscous", "motor.idle_torque", "motor.inertia")
    assert found.matrix[2] == pytest.approx([0.0, 0.0, 4e-4])


def test_a_value_that_a_later_file_changes_has_no_covariance_of_before(tmp_path):
    found = written(tmp_path, STEADY, ({"motor.idle_torque": entry(6.0, "Nm")}, None))
    found = found.covariance(found.stated().start)
    assert found.names == ("motor.viscous",) and found.matrix == pytest.approx(np.array([[1e-4]]))


def test_values_of_a_later_file_have_its_covariance(tmp_path):
    later = ({"motor.viscous": entry(0.12, "Nm s/rad", std=0.03)}, (["motor.viscous"], [[9e-4]]))
    found = written(tmp_path, STEADY, later)
    found = found.covariance(found.stated().start)
    assert found.names == ("motor.idle_torque", "motor.viscous")
    assert found.matrix == pytest.approx(np.diag([1e-2, 9e-4]))


def test_of_a_single_recording_the_scatter_between_recordings_counts_too(tmp_path):
    values = {"motor.idle_torque": entry(5.0, "Nm", std=0.1, repeatability=0.4)}
    loaded = written(tmp_path, (values, (["motor.idle_torque"], [[1e-2]])))
    assert loaded.covariance(loaded.stated().start).matrix == pytest.approx(np.array([[1e-2]]))
    assert loaded.covariance(loaded.stated().start, single=True).matrix == pytest.approx(np.array([[0.17]]))


def test_no_file_knows_anything(tmp_path):
    loaded = written(tmp_path, ({"motor.inertia": 2.0}, None))
    assert loaded.covariance(loaded.stated().start) is None


def test_of_what_was_set_by_hand_or_stands_in_a_sum_nothing_is_known(tmp_path):
    loaded = written(tmp_path, STEADY)
    set_by_hand = loaded.stated().start.with_values({"motor.idle_torque": 7.0})
    assert loaded.covariance(set_by_hand).names == ("motor.viscous",)
    summed = loaded.stated().start.with_values({"total.viscous": 0.3})
    assert loaded.covariance(summed).names == ("motor.idle_torque",)


def test_scatter_that_a_later_file_has_in_its_variance_is_not_added_again(tmp_path):
    first = ({"motor.idle_torque": entry(5.0, "Nm", std=0.1, repeatability=0.4)}, (["motor.idle_torque"], [[1e-2]]))
    second = ({"motor.idle_torque": entry(5.0, "Nm", std=0.4123)}, (["motor.idle_torque"], [[0.17]]))
    loaded = written(tmp_path, first, second)
    assert loaded.covariance(loaded.stated().start, single=True).matrix == pytest.approx(np.array([[0.17]]))
