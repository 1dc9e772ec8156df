"""The contract of the smooth laws: every name of the table calls its own law."""

import importlib
import pkgutil
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from numba import njit

from drivetool.drive import chain, effects
from drivetool.drive.compile.machine_code import address
from drivetool.drive.effects import drag
from drivetool.drive.effects.catalogue import LAW_TORQUES
from drivetool.drive.kernel.laws import law_torque
from tests.drive.test_effects import OUTPUTS, base
from tests.drive.test_kernel import plant_of

POINT = -0.3, -0.7, 0.6, 1.0  # both arguments, time, side of the contact


@njit
def _called(place, code, a, b, time, side, p, out):
    law_torque(place, code, a, b, time, side, p, out)


def result(torque):
    """(3 + parameters,) result of a law; torque: its function, or its number in the kernel."""
    parameters, out = np.array([[0.7], [1.3], [2.0], [0.4], [1.6]]), np.zeros(8)
    if callable(torque):
        torque(*POINT, parameters, out)
    else:
        _called(address("law_torque"), torque, *POINT, parameters, out)
    return out


def test_the_order_of_the_laws_stays():
    """It fixes columns, sums and keys: a new law comes last."""
    assert [torque.__module__.rpartition(".")[2] for torque in LAW_TORQUES] == [
        "stribeck", "breakaway", "asymmetry", "drag", "drift", "ripple", "load_step", "hardening", "load_damping",
        "induction", "lugre"]


def test_every_number_reaches_its_own_law():
    given = [result(number) for number in range(len(LAW_TORQUES))]
    for found, torque in zip(given, LAW_TORQUES, strict=True):
        np.testing.assert_allclose(found, result(torque), rtol=1e-13, atol=0.0, err_msg=torque.__module__)
    for one, other in combinations(given, 2):
        assert np.abs(one - other).max() > 1e-3


@pytest.mark.parametrize("number", [-1, len(LAW_TORQUES), 100])
def test_a_number_of_no_law_gives_no_torque(number):
    assert np.isnan(result(number)).all()


def test_every_law_of_an_effect_is_in_the_table():
    files = [importlib.import_module(f"{effects.__name__}.{found.name}")
             for found in pkgutil.iter_modules(effects.__path__)]
    assert {file.torque for file in files if hasattr(file, "torque")} == set(LAW_TORQUES)


def test_a_law_that_is_not_in_the_table_cannot_be_assembled(monkeypatch):
    def stamp(assembly, body):
        assembly.law(result, [assembly.number(1.0)], {body: assembly.number(1.0)}, body=body)

    other = [(replace(e, stamp=stamp, present=()) if e is drag.EFFECT else e, owner, k)
             for e, owner, k in base().effects()]
    monkeypatch.setattr(chain, "_effects", lambda *_: tuple(other))
    with pytest.raises(ValueError, match=r"tests\.drive\.test_laws adds a law that its EFFECT does not declare"):
        plant_of(base(), OUTPUTS)
