"""Realbeam's service and the one in peer.py, asked in turns for the same scan in one run.

    scripts/bench_peer.sh SCAN.bin [REQUESTS]

Prints medians in ms: the whole answer as a client sees it, the model's own run as the service tells it, and what is left, which is all
that a service adds: HTTP, decoding, projection, ray drop, reconstruction, encoding. The client is the same for both.
"""

import http.client
import re
import statistics
import sys
import time

ours, peer, scan, requests = int(sys.argv[1]), int(sys.argv[2]), open(sys.argv[3], "rb").read(), int(sys.argv[4])


def infer_ms(headers):
    timing = headers.get("server-timing")
    return float(re.search(r"infer;dur=([\d.]+)", timing)[1]) if timing else float(headers["x-infer-ms"])


def ask(connection, seed):
    # The other one's threads may still spin.
    time.sleep(0.05)
    started = time.perf_counter()
    connection.request("POST", f"/v1/scan?seed={seed}", scan, {"content-type": "application/octet-stream"})
    answer = connection.getresponse()
    body = answer.read()
    whole = (time.perf_counter() - started) * 1e3
    assert answer.status == 200 and len(body) > len(scan) // 4, answer.status
    return whole, infer_ms(answer.headers)


connections = {"realbeam-server": ours, "FastAPI, numpy": peer}
connections = {name: http.client.HTTPConnection("127.0.0.1", port) for name, port in connections.items()}
times = {name: [] for name in connections}
for seed in range(requests + 5):
    for name, connection in connections.items():
        found = ask(connection, seed)
        # The first ones warm up.
        if seed >= 5:
            times[name].append(found)
print("| | whole answer, ms | model's own run, ms | everything else, ms |\n|---|---|---|---|")
beyond = []
for name, found in times.items():
    whole, infer = (statistics.median(values) for values in zip(*found))
    beyond.append(statistics.median(w - i for w, i in found))
    print(f"| {name} | {whole:.1f} | {infer:.1f} | {beyond[-1]:.2f} |")
print(f"\nEverything else is {beyond[1] / beyond[0]:.1f} times cheaper; medians of {requests} answers each, in turns.")
