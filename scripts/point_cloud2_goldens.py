#!/usr/bin/env python3
"""Writes the ROS messages that the tests of `lidar` read, serialised by other people's software:

    pip install rosbags==0.11.9 && scripts/point_cloud2_goldens.py lidar/tests/data tests/data

The values are formulas, which lidar/tests/formats_point_cloud2.rs repeats.
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

ROS = get_typestore(Stores.ROS2_HUMBLE)
TYPES = ROS.types
NUMBERS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


def message(fields, columns, *, height=1, point_step=None, row_padding=0, big_endian=False, dense=True, filling=0):
    """A PointCloud2 of fields (name, offset, type, count) and their columns; bytes between fields are `filling`."""
    points = len(columns[fields[0][0]])
    order = ">" if big_endian else "<"
    step = point_step or max(offset + np.dtype(kind).itemsize * count for _, offset, kind, count in fields)
    data = np.full((points, step), filling, dtype=np.uint8)
    for name, offset, kind, count in fields:
        values = np.asarray(columns[name]).reshape(points, count).astype(order + kind)
        data[:, offset : offset + values.itemsize * count] = values.view(np.uint8).reshape(points, values.itemsize * count)
    width = points // height
    rows = data.reshape(height, width * step)
    rows = np.concatenate([rows, np.full((height, row_padding), filling, dtype=np.uint8)], axis=1)
    point_field = TYPES["sensor_msgs/msg/PointField"]
    return TYPES["sensor_msgs/msg/PointCloud2"](
        header=TYPES["std_msgs/msg/Header"](
            stamp=TYPES["builtin_interfaces/msg/Time"](sec=1_700_000_000, nanosec=123_456_789), frame_id="lidar_top"
        ),
        height=height,
        width=width,
        fields=[point_field(name, offset, NUMBERS[kind], count) for name, offset, kind, count in fields],
        is_bigendian=big_endian,
        point_step=step,
        row_step=rows.shape[1],
        data=rows.reshape(-1),
        is_dense=dense,
    )


def serialised(ros_message, little_endian=True):
    return bytes(ROS.serialize_cdr(ros_message, ros_message.__msgtype__, little_endian=little_endian))


def goldens():
    i = np.arange(6)
    x, y, z = i + 0.5, -0.25 * i, 0.125 * i
    # Autoware's PointXYZIRC: an 8-bit intensity, an enumeration, and a ring called channel.
    xyzirc = [("x", 0, "f4", 1), ("y", 4, "f4", 1), ("z", 8, "f4", 1), ("intensity", 12, "u1", 1)]
    xyzirc += [("return_type", 13, "u1", 1), ("channel", 14, "u2", 1)]
    values = {"x": x, "y": y, "z": z, "intensity": 40 * i, "return_type": i % 2, "channel": 5 - i}
    yield "xyzirc", serialised(message(xyzirc, values))
    yield "xyzirc_big_endian_message", serialised(message(xyzirc, values), little_endian=False)
    yield "xyzirc_big_endian_points", serialised(message(xyzirc, values, big_endian=True))
    # Ouster's: bytes between the fields, times in nanoseconds, an organised cloud of 2 rows whose rows end in padding.
    ouster = [("x", 0, "f4", 1), ("y", 4, "f4", 1), ("z", 8, "f4", 1), ("intensity", 16, "f4", 1), ("t", 20, "u4", 1)]
    ouster += [("reflectivity", 24, "u2", 1), ("ring", 26, "u2", 1), ("ambient", 28, "u2", 1), ("range", 32, "u4", 1)]
    values = {"x": np.where(i == 4, np.nan, x), "y": y, "z": z, "intensity": 100.0 * i, "t": 16_000_000 * i}
    values |= {"reflectivity": 7 * i, "ring": i // 3, "ambient": 1000 + i, "range": 1000 * i}
    organised = {"height": 2, "point_step": 48, "row_padding": 5, "dense": False, "filling": 0xAA}
    yield "ouster_organised", serialised(message(ouster, values, **organised))
    # Every datatype, several values in one field, PCL's name for padding, doubles as coordinates.
    every = [("z", 0, "f8", 1), ("y", 8, "f8", 1), ("x", 16, "f8", 1), ("_", 24, "u1", 3), ("i8", 27, "i1", 1)]
    every += [("u8", 28, "u1", 1), ("i16", 30, "i2", 1), ("u16", 32, "u2", 1), ("i32", 34, "i4", 1), ("u32", 38, "u4", 1)]
    every += [("f32", 42, "f4", 1), ("normal", 46, "f4", 3), ("intensity", 58, "i2", 1)]
    values = {"x": x, "y": y, "z": z, "_": np.zeros((6, 3)), "i8": -i, "u8": 250 + i % 6, "i16": -300 * i, "u16": 60_000 + i}
    values |= {"i32": -100_000 * i, "u32": 4_000_000_000 + i, "f32": 0.1 * i, "intensity": 300 * i}
    values |= {"normal": np.stack([i, i + 10, i + 20], axis=1)}
    yield "every_datatype", serialised(message(every, values, point_step=64))
    yield "empty", serialised(message(xyzirc, {name: [] for name, *_ in xyzirc}))


def scan(folder):
    """The real scan that lies in tests/data in every format."""
    points = np.load(folder / "hdl32e.npy")
    fields, offset = [], 0
    for name in points.dtype.names:
        kind = points.dtype[name].str[1:]
        fields.append((name, offset, kind, 1))
        offset += points.dtype[name].itemsize
    return serialised(message(fields, {name: points[name] for name in points.dtype.names}))


def main():
    small, real = Path(sys.argv[1]), Path(sys.argv[2])
    for name, content in goldens():
        (small / f"{name}.cdr").write_bytes(content)
    (real / "hdl32e.cdr").write_bytes(scan(real))


main()
