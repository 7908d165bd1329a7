"""The service that a user would write in Python: FastAPI, numpy, onnxruntime, on the same model.onnx and the same kind of body.

    MODEL=models/hdl64e/3/model.onnx THREADS=2 uvicorn peer:app --app-dir benches/peer --port 8090

POST /v1/scan takes float32 x, y, z, intensity and returns the same; the header x-infer-ms tells the model's own run.
"""

import json
import os
import time

import numpy as np
import onnxruntime
from fastapi import FastAPI, Request, Response

options = onnxruntime.SessionOptions()
options.intra_op_num_threads = int(os.environ.get("THREADS", "2"))
session = onnxruntime.InferenceSession(os.environ["MODEL"], options, providers=["CPUExecutionProvider"])
card = json.loads(session.get_modelmeta().custom_metadata_map["realbeam"])
sensor, noise_channels = card["sensor"], card["noise_channels"]
# Midway between two rings a point belongs to the next.
elevations = np.radians(np.array(sensor["elevation_deg"], np.float32))
borders = -(elevations[1:] + elevations[:-1]) / 2
rings, columns = len(elevations), sensor["columns"]
app = FastAPI()


@app.post("/v1/scan")
async def scan(request: Request, seed: int = 0):
    points = np.frombuffer(await request.body(), np.float32).reshape(-1, 4)
    x, y, z, intensity = points.T
    flat = np.hypot(x, y)
    range_m = np.hypot(flat, z)
    ring = np.searchsorted(borders, -np.arctan2(z, flat))
    column = ((np.pi - np.arctan2(y, x)) * (columns / (2 * np.pi))).astype(np.int64) % columns
    pixel = ring * columns + column
    # The nearest return of a pixel wins: farthest first, so that the nearest is written last.
    order = np.argsort(-range_m)
    winner = np.full(rings * columns, -1)
    winner[pixel[order]] = order
    hit = np.flatnonzero(winner >= 0)
    won = winner[hit]
    image = np.zeros((1, 3, rings * columns), np.float32)
    image[0, 0, hit] = range_m[won]
    image[0, 1, hit] = intensity[won]

    chance = np.random.default_rng(seed)
    noise = chance.random((1, noise_channels, rings, columns), np.float32)
    feed = {"scan": image.reshape(1, 3, rings, columns)} | ({"noise": noise} if noise_channels else {})
    started = time.perf_counter()
    measured, reflectance, keep = session.run(["range", "reflectance", "keep"], feed)
    infer_ms = (time.perf_counter() - started) * 1e3

    drawn = chance.random(rings * columns, np.float32)
    kept = drawn[hit] < keep.reshape(-1)[hit]
    hit, won = hit[kept], won[kept]
    out = np.empty((len(won), 4), np.float32)
    out[:, :3] = points[won, :3] * (measured.reshape(-1)[hit] / range_m[won])[:, None]
    out[:, 3] = reflectance.reshape(-1)[hit]
    return Response(out.tobytes(), media_type="application/octet-stream", headers={"x-infer-ms": f"{infer_ms:.3f}"})
