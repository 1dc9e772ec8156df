"""The same messages in every MCAP encoding, by the stock encoders, and read back by the stock decoders."""

from __future__ import annotations

import json
import warnings
from functools import cache
from io import BytesIO
from types import SimpleNamespace

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from tests.mcap_bytes import Log, build

JOINTS = ("motor", "load")
ROS2_TEXT = """std_msgs/Header header
uint8 state  # a number between two others, for the padding
float64 torque  # [Nm]
float32 temperature
int32 counts
float64 speed  # [rad/s]
string note
string[] name
float64[] effort
uint64 MOST=7
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
ROS1_TEXT = ROS2_TEXT.replace("builtin_interfaces/Time stamp", "uint32 seq\ntime stamp").partition(
    "=" * 80 + "\nMSG: b")[0]
PROTO_NAME = "site.Drive"


def rows(n: int, step_ns: int, start_ns: int, seed: int = 3) -> list[dict]:
    """Messages with full mantissas, so that any rounding shows."""
    rng = np.random.default_rng(seed)
    torque, speed = rng.normal(size=n).tolist(), (100 + rng.normal(size=n)).tolist()
    effort = rng.normal(size=(n, 2)).tolist()
    counts = rng.integers(-2**31, 2**31, n).tolist()
    temperature = rng.normal(size=n).astype(np.float32).astype(float).tolist()
    return [{"stamp": start_ns + k * step_ns, "state": k % 3, "torque": torque[k], "temperature": temperature[k],
             "counts": counts[k], "speed": speed[k], "note": "", "name": list(JOINTS), "effort": effort[k]}
            for k in range(n)]


def encoded(encoding: str, messages: list[dict]) -> tuple[str, str, bytes, str, list[bytes]]:
    """(schema name, schema encoding, schema, message encoding, messages as bytes)."""
    return _ENCODERS[encoding](messages)


def write(path, encoding: str, messages: list[dict], topic: str = "/drive", **options) -> None:
    """One MCAP file with one topic; the log time is the stamp, the publish time 1 ms later."""
    write_topics(path, [(topic, encoding, messages)], **options)


def write_by_hand(path, encoding: str, messages: list[dict], packing: str) -> None:
    """As `write`, without the package that reads it."""
    *schema, message_encoding, texts = encoded(encoding, messages)
    entries = [(1, message["stamp"], message["stamp"] + 1_000_000, content)
               for message, content in zip(messages, texts, strict=True)]
    path.write_bytes(build(Log([tuple(schema)], [("/drive", message_encoding, 1, {})],
                               [entries[k:k + 40] for k in range(0, len(entries), 40)], packing)))


def write_topics(path, topics, chunk: int = 4096, compression=CompressionType.ZSTD, chunked: bool = True,
                 index: bool = True, metadata=None) -> None:
    """Several topics [(name, encoding, messages)], interleaved by their stamps."""
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=chunk, compression=compression, use_chunking=chunked,
                        index_types=IndexType.ALL if index else IndexType.NONE, use_summary_offsets=index,
                        repeat_channels=index, repeat_schemas=index, use_statistics=index)
        writer.start()
        everything = []
        for name, encoding, messages in topics:
            schema_name, schema_encoding, schema, message_encoding, texts = encoded(encoding, messages)
            sid = writer.register_schema(schema_name, schema_encoding, schema)
            cid = writer.register_channel(name, message_encoding, sid, metadata or {})
            everything += [(message["stamp"], cid, k, text)
                           for k, (message, text) in enumerate(zip(messages, texts, strict=True))]
        for stamp, cid, k, text in sorted(everything, key=lambda entry: entry[:2]):
            writer.add_message(cid, stamp, text, stamp + 1_000_000, k)
        writer.finish()


def _json(messages):
    schema = {"type": "object", "properties": {
        "torque": {"type": "number", "unit": "Nm"}, "speed": {"type": "number", "unit": "rad/s"},
        "effort": {"type": "array", "items": {"type": "number", "unit": "Nm"}}}}
    texts = [json.dumps({"header": {"stamp": dict(zip(("sec", "nanosec"), divmod(m["stamp"], 10**9), strict=True))},
                         **{key: value for key, value in m.items() if key != "stamp"}}).encode()
             for m in messages]
    return "drive", "jsonschema", json.dumps(schema).encode(), "json", texts


def _plain(m: dict, **stamp) -> SimpleNamespace:
    return SimpleNamespace(**{key: value for key, value in m.items() if key != "stamp"}, header=SimpleNamespace(
        seq=0, stamp=SimpleNamespace(**stamp), frame_id="base"))


def _cdr(messages):
    from mcap_ros2._dynamic import serialize_dynamic

    encode = serialize_dynamic("site_msgs/msg/Drive", ROS2_TEXT)["site_msgs/msg/Drive"]
    texts = [encode(_plain(m, sec=m["stamp"] // 10**9, nanosec=m["stamp"] % 10**9)) for m in messages]
    return "site_msgs/msg/Drive", "ros2msg", ROS2_TEXT.encode(), "cdr", texts


def _ros1(messages):
    from mcap_ros1._vendor.genpy import dynamic
    from mcap_ros1._vendor.genpy.rostime import Time

    kind = dynamic.generate_dynamic("site_msgs/Drive", ROS1_TEXT)["site_msgs/Drive"]
    texts = []
    for m in messages:
        message = kind()
        message.header.stamp = Time(m["stamp"] // 10**9, m["stamp"] % 10**9)
        message.header.frame_id = "base"
        for key in message.__slots__[1:]:
            setattr(message, key, m[key])
        buffer = BytesIO()
        message.serialize(buffer)
        texts.append(buffer.getvalue())
    return "site_msgs/Drive", "ros1msg", ROS1_TEXT.encode(), "ros1", texts


@cache
def proto_class():
    """A message class made from descriptors, and its FileDescriptorSet."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

    file = descriptor_pb2.FileDescriptorProto(name="drive.proto", package="site", syntax="proto3",
                                              dependency=["google/protobuf/timestamp.proto"])
    message = file.message_type.add(name="Drive")
    kind = descriptor_pb2.FieldDescriptorProto
    for number, (name, of, many) in enumerate([
            ("stamp", kind.TYPE_MESSAGE, 0), ("state", kind.TYPE_UINT32, 0), ("torque", kind.TYPE_DOUBLE, 0),
            ("temperature", kind.TYPE_FLOAT, 0), ("counts", kind.TYPE_SINT32, 0), ("speed", kind.TYPE_DOUBLE, 0),
            ("note", kind.TYPE_STRING, 0), ("name", kind.TYPE_STRING, 1), ("effort", kind.TYPE_DOUBLE, 1),
            ("plain", kind.TYPE_INT32, 0), ("sizes", kind.TYPE_INT64, 1)], 1):
        field = message.field.add(name=name, number=number, type=of,
                                  label=kind.LABEL_REPEATED if many else kind.LABEL_OPTIONAL)
        if of == kind.TYPE_MESSAGE:
            field.type_name = ".google.protobuf.Timestamp"
    wrapper = file.message_type.add(name="Logged")
    wrapper.field.add(name="header", number=1, type=kind.TYPE_MESSAGE, type_name=".site.Header",
                      label=kind.LABEL_OPTIONAL)
    header = file.message_type.add(name="Header")
    header.field.add(name="stamp", number=1, type=kind.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp",
                     label=kind.LABEL_OPTIONAL)
    pool = descriptor_pool.DescriptorPool()
    stamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    pool.Add(stamp)
    message.field[0].type_name, message.field[0].name = ".site.Header", "header"
    pool.Add(file)
    found = message_factory.GetMessageClass(pool.FindMessageTypeByName(PROTO_NAME))
    return found, descriptor_pb2.FileDescriptorSet(file=[stamp, file]).SerializeToString()


def _protobuf(messages):
    kind, descriptors = proto_class()
    texts = []
    for m in messages:
        message = kind(**{key: value for key, value in m.items() if key != "stamp"})
        message.header.stamp.seconds, message.header.stamp.nanos = divmod(m["stamp"], 10**9)
        message.plain = m["counts"]
        message.sizes.extend([m["state"], m["counts"], 2**40])
        texts.append(message.SerializeToString())
    return PROTO_NAME, "protobuf", descriptors, "protobuf", texts


_ENCODERS = {"json": _json, "cdr": _cdr, "ros1": _ros1, "protobuf": _protobuf}
ENCODINGS = tuple(_ENCODERS)


def stock(path) -> list[tuple[str, int, object]]:
    """(topic, log time, message) by the stock decoders, in the order of the file."""
    from mcap.decoder import DecoderFactory

    class Json(DecoderFactory):
        def decoder_for(self, message_encoding, schema):
            return json.loads if message_encoding == "json" else None

    with warnings.catch_warnings(), open(path, "rb") as file:
        warnings.simplefilter("ignore")
        from mcap_protobuf.decoder import DecoderFactory as Protobuf
        from mcap_ros1.decoder import DecoderFactory as Ros1
        from mcap_ros2.decoder import DecoderFactory as Ros2

        reader = make_reader(file, decoder_factories=[Json(), Ros2(), Ros1(), Protobuf()])
        return [(channel.topic, message.log_time, decoded) for _, channel, message, decoded
                in reader.iter_decoded_messages(log_time_order=False)]
