#!/usr/bin/env python3
"""Writes the tests' models: graphs of a few element-wise nodes that meet, or break, the contract of a Realbeam model.

    pip install onnx==1.23.2 && python3 make_models.py

models/passthrough/1    16 rings, 360 fixed columns, no noise: gives the scan back as it is, every ray kept
models/passthrough/2    16 rings, dynamic columns, one noise channel: range + 0.01 m * noise, 0.8 * reflectance,
                        keep = min(1, 0.9 + 0.1 * class), so that labelled rays always stay
models/hdl64e/1         as passthrough/2, 64 rings and 2048 columns
models/ghosts/1         16 rings: gives the scan back as it is; where it has no return, keep = 0.25, range = 20 m + 10 m * noise and
                        reflectance = 0.3; its card says that it adds returns
models/ghosts/2         the same graph, but its card does not say so
misbehaved/nan/1        as passthrough/2, with a range of NaN: a model's check refuses it
misbehaved/nan/2        the same, and its card says that it adds returns
misbehaved/unruly/1     16 rings: a quarter of the ranges each is negative, infinite, as it was, and halved; reflectance runs from
                        -1 to 2; keep = 2
refused/*.onnx          one broken promise each, named after it
hostile/*.onnx          as passthrough/2, and what only a run tells: an operator that does not exist, numbers that are others every
                        time, a loop without an end, and more memory than there is
"""
import json
import pathlib

import onnx
from onnx import TensorProto, helper

HERE = pathlib.Path(__file__).parent


def card(name, elevation_deg, columns, noise_channels, adds_returns=False):
    return ({"adds_returns": True} if adds_returns else {}) | {
        "schema": 1,
        "name": name,
        "summary": "Element-wise stand-in for tests",
        "licence": "MIT OR Apache-2.0",
        "sensor": {
            "name": f"{len(elevation_deg)} rings for tests",
            "columns": columns,
            "range_min_m": 0.5,
            "range_max_m": 120.0,
            "rotation_hz": 10.0,
            "elevation_deg": elevation_deg,
        },
        "column_multiple": 8,
        "noise_channels": noise_channels,
        "classes": ["unlabelled", "car"],
    }


def constant(name, value):
    return helper.make_tensor(name, TensorProto.FLOAT, [], [value])


def model(card, identity=False, nan=False, unruly=False, ghosts=False, rings=None, columns="column", with_card=True, external=False,
          hostile=()):
    rings = rings or len(card["sensor"]["elevation_deg"])
    info = lambda name, channels: helper.make_tensor_value_info(
        name, TensorProto.FLOAT, ["batch", channels, rings, columns])
    node = helper.make_node
    noise = card["noise_channels"]
    nodes = [node("Split", ["scan"], ["range_in", "reflectance_in", "class_in"], axis=1, num_outputs=3)]
    if identity:
        nodes += [
            node("Identity", ["range_in"], ["range"]),
            node("Identity", ["reflectance_in"], ["reflectance"]),
            node("Greater", ["range_in", "zero"], ["seen"]),
            node("Cast", ["seen"], ["keep"], to=TensorProto.FLOAT),
        ]
    elif ghosts:
        nodes += [
            node("Greater", ["range_in", "zero"], ["seen"]),
            node("Mul", ["noise", "ten"], ["spread"]),
            node("Add", ["spread", "twenty"], ["ghost"]),
            node("Where", ["seen", "range_in", "ghost"], ["range"]),
            node("Where", ["seen", "reflectance_in", "three_tenths"], ["reflectance"]),
            node("Where", ["seen", "one", "quarter"], ["keep"]),
        ]
    elif unruly:
        nodes += [
            node("Mul", ["noise", "four"], ["quarters"]),
            node("Floor", ["quarters"], ["quarter"]),
            node("Sub", ["quarter", "one"], ["divisor"]),
            node("Div", ["range_in", "divisor"], ["range"]),
            node("Mul", ["reflectance_in", "three"], ["stretched"]),
            node("Sub", ["stretched", "one"], ["reflectance"]),
            node("Sub", ["range_in", "range_in"], ["nothing"]),
            node("Add", ["nothing", "two"], ["keep"]),
        ]
    else:
        nodes += [
            node("Mul", ["noise", "not_a_number" if nan else "centimetre"], ["jitter"]),
            node("Add", ["range_in", "jitter"], ["range"]),
            node("Mul", ["reflectance_in", "share"], ["reflectance"]),
            node("Mul", ["class_in", "tenth"], ["labelled"]),
            node("Add", ["labelled", "base"], ["wish"]),
            node("Min", ["wish", "one"], ["keep"]),
        ]
    nodes += hostile
    initializers = [constant(*pair) for pair in
                    [("zero", 0.0), ("centimetre", 0.01), ("share", 0.8), ("tenth", 0.1), ("base", 0.9), ("one", 1.0),
                     ("two", 2.0), ("three", 3.0), ("four", 4.0),
                     ("not_a_number", float("nan"))]]
    if ghosts:
        initializers += [constant(*pair) for pair in
                         [("quarter", 0.25), ("three_tenths", 0.3), ("ten", 10.0), ("twenty", 20.0)]]
    if external:
        tensor = TensorProto(name="elsewhere", data_type=TensorProto.FLOAT, dims=[4])
        tensor.data_location = TensorProto.EXTERNAL
        tensor.external_data.add(key="location", value="../../secret.bin")
        initializers.append(tensor)
    inputs = [info("scan", 3)] + ([info("noise", noise)] if noise else [])
    outputs = [info("range", 1), info("reflectance", 1), info("keep", 1)]
    graph = helper.make_graph(nodes, "stand_in", inputs, outputs, initializers)
    proto = helper.make_model(graph, producer_name="make_models.py", ir_version=9,
                              opset_imports=[helper.make_opsetid("", 18)])
    if with_card:
        helper.set_model_props(proto, {"realbeam": json.dumps(card)})
    return proto


def write(proto, path):
    path = HERE / path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(proto.SerializeToString(deterministic=True))


rings16 = [15.0 - 2.0 * i for i in range(16)]
rings64 = [1.9 - 0.335 * i for i in range(32)] + [-8.9 - 0.515 * i for i in range(32)]
exact = card("passthrough", rings16, 360, 0)
noisy = card("passthrough", rings16, 360, 1)
write(model(exact, identity=True, columns=360), "models/passthrough/1/model.onnx")
write(model(noisy), "models/passthrough/2/model.onnx")
write(model(card("hdl64e", rings64, 2048, 1)), "models/hdl64e/1/model.onnx")
write(model(card("nan", rings16, 360, 1), nan=True), "misbehaved/nan/1/model.onnx")
write(model(card("nan", rings16, 360, 1, adds_returns=True), nan=True), "misbehaved/nan/2/model.onnx")
write(model(card("ghosts", rings16, 360, 1, adds_returns=True), ghosts=True), "models/ghosts/1/model.onnx")
write(model(card("ghosts", rings16, 360, 1), ghosts=True), "models/ghosts/2/model.onnx")
write(model(card("unruly", rings16, 360, 1), unruly=True), "misbehaved/unruly/1/model.onnx")
write(model(noisy, with_card=False), "refused/no-card.onnx")
write(model(noisy, rings=15), "refused/fifteen-rings.onnx")
write(model(exact, identity=True, columns=512), "refused/columns-of-another-sensor.onnx")
write(model(noisy, external=True), "refused/external-data.onnx")
write(model(noisy, hostile=[helper.make_node("Gelu", ["range"], ["nowhere"], domain="com.microsoft")]),
      "refused/operator-of-the-runtime.onnx")


def hostile(name, *nodes):
    """The nodes work on `keep` once the model has made it."""
    proto = model(noisy, hostile=list(nodes))
    proto.graph.output[2].name = "last"
    for node in proto.graph.node:
        for names in (node.input, node.output):
            names[:] = [{"keep": "first", "last": "keep"}.get(name, name) for name in names]
    proto.graph.output[2].name = "keep"
    write(proto, f"hostile/{name}.onnx")


def body():
    """A loop's body that does nothing but go on."""
    info = helper.make_tensor_value_info
    nodes = [helper.make_node("Identity", ["go"], ["on"]), helper.make_node("Sqrt", ["state"], ["next"])]
    inputs = [info("i", TensorProto.INT64, []), info("go", TensorProto.BOOL, []), info("state", TensorProto.FLOAT, None)]
    return helper.make_graph(nodes, "body", inputs, [info("on", TensorProto.BOOL, []), info("next", TensorProto.FLOAT, None)])


def whole(name, dtype, values):
    tensor = helper.make_tensor(name, dtype, [len(values)] if name == "size" else [], values)
    return helper.make_node("Constant", [], [name], value=tensor)


hostile("no-such-operator", helper.make_node("Teleport", ["keep"], ["last"]))
hostile("moody", helper.make_node("RandomUniformLike", ["keep"], ["mood"]), helper.make_node("Mul", ["keep", "mood"], ["last"]))
hostile("endless", whole("trips", TensorProto.INT64, [2**62]), whole("go_on", TensorProto.BOOL, [True]),
        helper.make_node("Loop", ["trips", "go_on", "keep"], ["last"], body=body()))
hostile("hungry", whole("size", TensorProto.INT64, [2**34]), helper.make_node("ConstantOfShape", ["size"], ["huge"]),
        helper.make_node("ReduceSum", ["huge"], ["sum"], keepdims=0), helper.make_node("Add", ["keep", "sum"], ["last"]))
