"""Load torques that start or end, each at an instant that is not logged: a strip in the mill, a part on a table."""

from collections.abc import Mapping

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity, quantity_of

NEVER = 1e6  # s, the upper bound of the instant; a choice: 11 days, longer than a recording
STEP_NAMES = ("step", "step2", "step3", "step4")  # that a drive may have


def torque(_, __, time, side, p, out):
    """-A from t0 on, over a rise of p[2] seconds so that t0 has a derivative; A, t0 = p[0], p[1]."""
    s = (time - p[1, 0]) / p[2, 0] + 0.5
    s = min(max(s, 0.0), 1.0)
    out[3] = -s * s * (3.0 - 2.0 * s)
    out[0] = p[0, 0] * out[3]
    out[4] = p[0, 0] * 6.0 * s * (1.0 - s) / p[2, 0]
    out[5] = out[4] * (time - p[1, 0]) / p[2, 0]


def stamp(assembly, body):
    """On the body that they act on, which is not the last if a third mass has been found behind it."""
    for step in STEP_NAMES:
        if assembly.acts(body, f"{step}_torque"):
            parameters = [assembly.of_body(body, f"{step}_{what}") for what in ("torque", "time")]
            assembly.law(torque, [*parameters, assembly.number(2.0 * assembly.layout.step)], {}, body=body)


def has_record_steps(values: Mapping[str, float]) -> bool:
    """Whether a load step belongs to one record only."""
    return any(quantity_of(n) in STEP_RECORDS and v > 0.0 for n, v in values.items())


def values_in_record(values: Mapping[str, float], record: int) -> Mapping[str, float]:
    """The parameters in the record of that number: a load step of another record never occurs in it."""
    never = {n.replace("_record", "_time"): NEVER for n, v in values.items()
             if quantity_of(n) in STEP_RECORDS and v not in (0.0, record)}
    return {**values, **never}


STEP_QUANTITIES = {
    "torque": Quantity("{T}", "by how much the load torque changes", (-1e12, 1e12), 1e-2, 0.0),
    "time": Quantity("s", "when the load torque changes", (-NEVER, NEVER), 1e-3, 0.0),
    "record": Quantity("", "the record with the change, by the CRC-32 of its sha256; 0: every record",
                       (0.0, 2.0**32), 1.0, 0.0),
}
STEP_TORQUES, STEP_TIMES, STEP_RECORDS = (
    tuple(f"{step}_{what}" for step in STEP_NAMES) for what in STEP_QUANTITIES)

EFFECT = Effect(
    code="load-step",
    of="body",
    quantities={f"{step}_{what}": quantity for step in STEP_NAMES for what, quantity in STEP_QUANTITIES.items()},
    stamp=stamp,
    torque=torque,
    law="T = A for t > t0",
    needs="a stretch of motion before and after; a repeated record distinguishes it from a drift",
    source="Basseville, Nikiforov 1993, Detection of Abrupt Changes",
    present=STEP_TORQUES,
    odd=False,
)
