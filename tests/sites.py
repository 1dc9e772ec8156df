"""Small sites of recordings, and what of their results must be equal."""

import csv
import io
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import yaml
from mcap.writer import Writer

from drivetool.site.results.summary import COST_COLUMNS
from tests.simulator.records import write_mcap

N, STEP = 4_000, 0.002
RECIPE = [{"command": "steady --drive one-body"}]


def channels(seed, coulomb=0.3, viscous=0.05):
    """Both directions at two speeds: torque and speed with noise, a record for `steady`."""
    rng = np.random.default_rng(seed)
    speed = np.repeat([10.0, -10.0, 30.0, -30.0], N // 4)
    torque = viscous * speed + coulomb * np.sign(speed) + 0.01 * rng.standard_normal(N)
    return torque, speed + 0.01 * rng.standard_normal(N)


def write(path, seed, metadata=None, **law):
    """A recording as Parquet."""
    torque, speed = channels(seed, **law)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    units = {"time": "s", "motor_torque": "Nm", "motor_speed": "rad/s"}
    schema = pa.schema([pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in units.items()],
                       metadata=metadata)
    pq.write_table(pa.table([np.arange(N) * STEP, torque, speed], schema=schema), path)
    return path


def write_with_clock(path, seed, began, metadata=None):
    """A recording as MCAP with absolute time [ns since 1970] and a metadata record."""
    torque, speed = channels(seed)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = path.with_suffix(".plain")
    write_mcap(plain, {"motor_torque": (torque, "Nm"), "motor_speed": (speed, "rad/s")}, STEP)
    from mcap.reader import make_reader

    with open(plain, "rb") as source, open(path, "wb") as target:
        writer = Writer(target)
        writer.start()
        known = {}
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.id not in known:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, kind)
            at = began + message.log_time
            writer.add_message(known[channel.id], at, message.data, at)
        if metadata:
            writer.add_metadata("drive", metadata)
        writer.finish()
    plain.unlink()
    return path


def write_site(folder, recordings=None, recipe=RECIPE, bars=(), name="site.yaml"):
    """The site file."""
    content = {"schema": "drivetool/site/1", "recordings": recordings or [{"files": "logs/**/*.parquet"}],
               "recipe": list(recipe), "bars": list(bars)}
    path = Path(folder) / name
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def small(folder, machines=("press1", "press2"), count=2):
    """A site of that many recordings a machine, each of its own."""
    for i, machine in enumerate(machines):
        for k in range(count):
            write(Path(folder) / "logs" / machine / f"{k + 1:02d}.parquet", 100 * i + k, coulomb=0.3 + 0.01 * i)
    return write_site(folder)


def table(out):
    """The rows of the summary as mappings."""
    return pq.read_table(Path(out) / "summary.parquet").to_pylist()


def compared(out):
    """What must be equal however a site was run: every file but the manifest; of the summary all but the cost."""
    found = {}
    for path in sorted(p for p in Path(out).rglob("*") if p.is_file()):
        name, data = path.relative_to(out).as_posix(), path.read_bytes()
        if name == "summary.parquet":
            data = pq.read_table(path).drop_columns(list(COST_COLUMNS)).to_pylist()
        elif name == "summary.csv":
            data = [row[:-len(COST_COLUMNS)] for row in csv.reader(io.StringIO(data.decode()))]
        if name != "manifest.jsonl":
            found[name] = data
    return found
