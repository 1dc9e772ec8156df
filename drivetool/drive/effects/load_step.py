"""A load torque that sets in once, at an instant nobody logged."""

from collections.abc import Mapping

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

NEVER = 1e6  # s, the upper bound of the instant


def torque(_, __, time, side, p, out):
    """-A from t0 on, over a rise of p[2] seconds so that t0 has a derivative; A, t0 = p[0], p[1]."""
    s = (time - p[1, 0]) / p[2, 0] + 0.5
    s = min(max(s, 0.0), 1.0)
    out[3] = -s * s * (3.0 - 2.0 * s)
    out[0] = p[0, 0] * out[3]
    out[4] = p[0, 0] * 6.0 * s * (1.0 - s) / p[2, 0]


def stamp(assembly, body):
    """On the body that it acts on, which need not be the last once a third mass is found behind it."""
    if assembly.acts(body, "step_torque"):
        parameters = [assembly.of_body(body, s) for s in ("step_torque", "step_time")]
        assembly.law("load-step", [*parameters, assembly.number(2.0 * assembly.layout.step)], {}, body=body)


def only_in(values: Mapping[str, float]) -> bool:
    """Whether a load sets in in one record only."""
    return any(n.endswith(".step_record") and v > 0.0 for n, v in values.items())


def felt_in(values: Mapping[str, float], record: int) -> Mapping[str, float]:
    """The parameters as they are in the record of that number: a load that sets in elsewhere never does here."""
    never = {n.replace("_record", "_time"): NEVER for n, v in values.items()
             if n.endswith(".step_record") and v not in (0.0, record)}
    return {**values, **never}


EFFECT = Effect(
    code="load-step",
    of="body",
    quantities={
        "step_torque": Quantity("{T}", "load torque that sets in", (-1e12, 1e12), 1e-2, 0.0),
        "step_time": Quantity("s", "when it sets in", (-NEVER, NEVER), 1e-3, 0.0),
        "step_record": Quantity("", "the record in which it does, by the CRC-32 of its sha256; 0: in every one",
                                (0.0, 2.0**32), 1.0, 0.0),
    },
    stamp=stamp,
    law="T = A for t > t0",
    needs="a stretch of motion before and after; a repeated record tells it from a drift",
    source="Basseville, Nikiforov 1993, Detection of Abrupt Changes",
    present=("step_torque",),
    odd=False,
)
