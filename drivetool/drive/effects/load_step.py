"""Load torques that set in or end, each at an instant nobody logged: a strip in the mill, a part on the table."""

from collections.abc import Mapping

from drivetool.drive.effects.effect import Effect
from drivetool.quantity import Quantity

NEVER = 1e6  # s, the upper bound of the instant
STEPS = ("step", "step2", "step3", "step4")  # that a drive may have


def torque(_, __, time, side, p, out):
    """-A from t0 on, over a rise of p[2] seconds so that t0 has a derivative; A, t0 = p[0], p[1]."""
    s = (time - p[1, 0]) / p[2, 0] + 0.5
    s = min(max(s, 0.0), 1.0)
    out[3] = -s * s * (3.0 - 2.0 * s)
    out[0] = p[0, 0] * out[3]
    out[4] = p[0, 0] * 6.0 * s * (1.0 - s) / p[2, 0]


def stamp(assembly, body):
    """On the body that they act on, which need not be the last once a third mass is found behind it."""
    for step in STEPS:
        if assembly.acts(body, f"{step}_torque"):
            parameters = [assembly.of_body(body, f"{step}_{what}") for what in ("torque", "time")]
            assembly.law("load-step", [*parameters, assembly.number(2.0 * assembly.layout.step)], {}, body=body)


def only_in(values: Mapping[str, float]) -> bool:
    """Whether a load sets in in one record only."""
    return any(n.endswith(RECORDS) and v > 0.0 for n, v in values.items())


def felt_in(values: Mapping[str, float], record: int) -> Mapping[str, float]:
    """The parameters as they are in the record of that number: a load that sets in elsewhere never does here."""
    never = {n.replace("_record", "_time"): NEVER for n, v in values.items()
             if n.endswith(RECORDS) and v not in (0.0, record)}
    return {**values, **never}


def _named(what: str) -> tuple[str, ...]:
    """A parameter of every step, as names of parameters end."""
    return tuple(f".{step}_{what}" for step in STEPS)


TORQUES, TIMES, RECORDS = _named("torque"), _named("time"), _named("record")
KINDS = {
    "torque": Quantity("{T}", "by how much the load torque changes", (-1e12, 1e12), 1e-2, 0.0),
    "time": Quantity("s", "when it does", (-NEVER, NEVER), 1e-3, 0.0),
    "record": Quantity("", "the record in which it does, by the CRC-32 of its sha256; 0: in every one",
                       (0.0, 2.0**32), 1.0, 0.0),
}

EFFECT = Effect(
    code="load-step",
    of="body",
    quantities={f"{step}_{what}": quantity for step in STEPS for what, quantity in KINDS.items()},
    stamp=stamp,
    law="T = A for t > t0",
    needs="a stretch of motion before and after; a repeated record tells it from a drift",
    source="Basseville, Nikiforov 1993, Detection of Abrupt Changes",
    present=tuple(name[1:] for name in TORQUES),
    odd=False,
)
