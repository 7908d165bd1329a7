"""Asks a running service everything that the unmodified tritonclient[http] can, and the same over gRPC: tritonclient_conformance.py HOST:PORT SCAN.bin

Uses the tests' models: `passthrough` gives range + 0.01 m * noise, 0.8 * reflectance, keep = min(1, 0.9 + 0.1 * class).
"""

import sys

import numpy as np
import tritonclient.grpc
import tritonclient.http as triton
from tritonclient.utils import InferenceServerException

client = triton.InferenceServerClient(sys.argv[1])
points = np.fromfile(sys.argv[2], "<f4").reshape(-1, 4)


def tensor(name, values, binary=True):
    given = triton.InferInput(name, list(values.shape), "FP32")
    given.set_data_from_numpy(values, binary_data=binary)
    return given


def refused(words, ask):
    try:
        ask()
    except InferenceServerException as error:
        assert words in str(error), f"`{error}` has no `{words}`"
    else:
        raise AssertionError(f"not refused, expected `{words}`")


# Health, metadata, configuration.
assert client.is_server_live() and client.is_server_ready()
server = client.get_server_metadata()
assert server["name"] == "realbeam-server" and "binary_tensor_data" in server["extensions"], server
for model in ("passthrough", "scan"):
    assert client.is_model_ready(model) and client.is_model_ready(model, "2")
    assert not client.is_model_ready(model, "99")
    assert client.get_model_metadata(model, "2")["versions"] == ["1", "2"]
assert not client.is_model_ready("no-such-model")
described = client.get_model_metadata("passthrough")
assert [(i["name"], i["datatype"], i["shape"]) for i in described["inputs"]] == [
    ("scan", "FP32", [-1, 3, 16, -1]),
    ("noise", "FP32", [-1, 1, 16, -1]),
]
assert client.get_model_metadata("scan")["inputs"] == [{"name": "POINTS", "datatype": "FP32", "shape": [-1, 4]}]
config = client.get_model_config("scan")
assert config["max_batch_size"] == 0 and config["input"][0]["data_type"] == "TYPE_FP32", config
refused("no model `no-such-model`", lambda: client.get_model_metadata("no-such-model"))

# A generator, its tensors as bytes and as JSON, in batches and on part of the columns.
random = np.random.default_rng(7)
scan = random.uniform(0, 50, (2, 3, 16, 64)).astype("<f4")
scan[:, 2] = random.integers(0, 2, (2, 16, 64))
noise = random.uniform(0, 1, (2, 1, 16, 64)).astype("<f4")
expected = {
    "range": scan[:, 0:1] + np.float32(0.01) * noise,
    "reflectance": np.float32(0.8) * scan[:, 1:2],
    "keep": np.minimum(1, np.float32(0.9) + np.float32(0.1) * scan[:, 2:3]),
}
for binary_in, binary_out in ((True, True), (True, False), (False, True), (False, False)):
    wanted = [triton.InferRequestedOutput(name, binary_data=binary_out) for name in ("keep", "range")]
    given = [tensor("noise", noise, binary_in), tensor("scan", scan, binary_in)]
    answer = client.infer("passthrough", given, outputs=wanted, request_id="frame-17")
    head = answer.get_response()
    assert (head["model_name"], head["model_version"], head["id"]) == ("passthrough", "2", "frame-17"), head
    assert [output["name"] for output in head["outputs"]] == ["keep", "range"]
    for name in ("keep", "range"):
        # One rounding of single precision a node, and 50 m at most.
        np.testing.assert_allclose(answer.as_numpy(name), expected[name], rtol=2e-7, atol=4e-6)
answer = client.infer("passthrough", [tensor("scan", scan), tensor("noise", noise)])
for name, values in expected.items():
    np.testing.assert_allclose(answer.as_numpy(name), values, rtol=2e-7, atol=4e-6)
refused("inputs are `scan [2, 3, 16, 64]`", lambda: client.infer("passthrough", [tensor("scan", scan)]))
refused("expected `scan [1 to 8, 3, 16, multiple of 8 up to 360]", lambda: client.infer("passthrough", []))
refused("no output `depth`", lambda: client.infer("passthrough", given, outputs=[triton.InferRequestedOutput("depth")]))
refused("classification", lambda: client.infer("passthrough", given, outputs=[triton.InferRequestedOutput("keep", class_count=3)]))

# The pipeline: the same points whichever way they come and go, the same as on /v1/scan.
alone = client.infer("scan", [tensor("POINTS", points)], parameters={"seed": 7}).as_numpy("POINTS")
assert alone.shape[1] == 4 and len(points) // 2 < len(alone) < len(points), alone.shape
ways = (
    client.infer("scan", [tensor("POINTS", points, False)], parameters={"seed": 7}),
    client.infer("scan", [tensor("POINTS", points)], query_params={"seed": 7}),
    client.infer("scan", [tensor("POINTS", points)], headers={"x-seed": "7"}),
    client.infer("scan", [tensor("POINTS", points)], "2", parameters={"seed": "7"}),
    client.infer(
        "scan",
        [tensor("POINTS", points)],
        query_params={"model": "passthrough", "seed": 7},
        outputs=[triton.InferRequestedOutput("POINTS", binary_data=False)],
    ),
)
for answer in ways:
    np.testing.assert_array_equal(answer.as_numpy("POINTS"), alone)
head = ways[0].get_response()
assert (head["model_name"], head["model_version"]) == ("scan", "2"), head
assert head["parameters"] == {"model": "passthrough", "seed": 7}, head
other = client.infer("scan", [tensor("POINTS", points)], parameters={"seed": 8}).as_numpy("POINTS")
assert other.shape != alone.shape or (other != alone).any(), "another seed is another answer"
assert len(client.infer("scan", [tensor("POINTS", points[:0])]).as_numpy("POINTS")) == 0
refused("expected POINTS [-1, 4]", lambda: client.infer("scan", [tensor("POINTS", points[:, :3])]))
refused("`sed` is unknown", lambda: client.infer("scan", [tensor("POINTS", points)], parameters={"sed": 7}))

# A raw body: the points and nothing else, as CARLA's `raw_data` is.
raw = client._post(
    "v2/models/scan/infer", points.tobytes(), {"Inference-Header-Content-Length": "0", "x-seed": "7"}, None
)
assert raw.status_code == 200
np.testing.assert_array_equal(triton.InferResult(raw, False).as_numpy("POINTS"), alone)

# Figures.
stats = client.get_inference_statistics("passthrough", "2")["model_stats"][0]
assert (stats["name"], stats["version"]) == ("passthrough", "2")
success = stats["inference_stats"]["success"]
assert success["count"] == 14 and success["ns"] > 0, stats
assert stats["inference_stats"]["fail"]["count"] == 6, stats
assert len(client.get_inference_statistics()["model_stats"]) == 5

# The same over gRPC, which has the same listener.
client = tritonclient.grpc.InferenceServerClient(sys.argv[1])


def message(name, values):
    given = tritonclient.grpc.InferInput(name, list(values.shape), "FP32")
    given.set_data_from_numpy(values)
    return given


assert client.is_server_live() and client.is_server_ready()
assert client.get_server_metadata().name == "realbeam-server"
for model in ("passthrough", "scan"):
    assert client.is_model_ready(model) and client.is_model_ready(model, "2")
    assert not client.is_model_ready(model, "99")
    assert client.get_model_metadata(model, "2").versions == ["1", "2"]
assert not client.is_model_ready("no-such-model")
assert client.get_model_metadata("passthrough", as_json=True)["inputs"] == [
    {"name": "scan", "datatype": "FP32", "shape": ["-1", "3", "16", "-1"]},
    {"name": "noise", "datatype": "FP32", "shape": ["-1", "1", "16", "-1"]},
]
refused("no model `no-such-model`", lambda: client.get_model_metadata("no-such-model"))
given = [message("noise", noise), message("scan", scan)]
wanted = [tritonclient.grpc.InferRequestedOutput(name) for name in ("keep", "range")]
answer = client.infer("passthrough", given, outputs=wanted, request_id="frame-17", client_timeout=60)
head = answer.get_response()
assert (head.model_name, head.model_version, head.id) == ("passthrough", "2", "frame-17"), head
assert [output.name for output in head.outputs] == ["keep", "range"]
for name in ("keep", "range"):
    np.testing.assert_allclose(answer.as_numpy(name), expected[name], rtol=2e-7, atol=4e-6)
refused("inputs are `scan [2, 3, 16, 64]`", lambda: client.infer("passthrough", [message("scan", scan)]))
refused("no output `depth`", lambda: client.infer("passthrough", given, outputs=[tritonclient.grpc.InferRequestedOutput("depth")]))
ways = (
    client.infer("scan", [message("POINTS", points)], parameters={"seed": 7}),
    client.infer("scan", [message("POINTS", points)], headers={"x-seed": "7"}),
    client.infer("scan", [message("POINTS", points)], "2", parameters={"seed": "7", "model": "passthrough"}),
)
for answer in ways:
    np.testing.assert_array_equal(answer.as_numpy("POINTS"), alone)
parameters = ways[0].get_response().parameters
assert (parameters["model"].string_param, parameters["seed"].int64_param) == ("passthrough", 7), parameters
refused("`sed` is unknown", lambda: client.infer("scan", [message("POINTS", points)], parameters={"sed": 7}))
refused("compressed messages are not taken", lambda: client.infer("scan", [message("POINTS", points)], compression_algorithm="gzip"))
client.close()
print("conforms")
