"""Realbeam's service and the one in peer.py, asked in turns for the same scan in one run.

    scripts/bench_peer.sh SCAN.bin [REQUESTS]

Prints medians in ms: the whole answer as a client sees it, the model's own run as the service tells it, and what is left, which is all
that a service adds: HTTP, decoding, projection, ray drop, reconstruction, encoding. The client is the same for both. The last line is what
the client and the kernel need for the bytes of such an answer alone (bytes_alone.py): nobody can be cheaper.
"""

import http.client
import pathlib
import re
import socket
import statistics
import subprocess
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
    return whole, infer_ms(answer.headers), len(body)


def start_bytes_alone(count):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    program = pathlib.Path(__file__).with_name("bytes_alone.py")
    process = subprocess.Popen([sys.executable, str(program), str(port), str(count)])
    for _ in range(100):
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            break
        except ConnectionRefusedError:
            time.sleep(0.05)
    return process, port


connections = {"realbeam-server": ours, "FastAPI, numpy": peer}
connections = {name: http.client.HTTPConnection("127.0.0.1", port) for name, port in connections.items()}
process, port = start_bytes_alone(ask(connections["realbeam-server"], 0)[2])
connections["the bytes alone"] = http.client.HTTPConnection("127.0.0.1", port)
times = {name: [] for name in connections}
for seed in range(requests + 5):
    for name, connection in connections.items():
        found = ask(connection, seed)
        # The first ones warm up.
        if seed >= 5:
            times[name].append(found[:2])
process.kill()
print("| | whole answer, ms | model's own run, ms | everything else, ms |\n|---|---|---|---|")
beyond = []
for name, found in times.items():
    whole, infer = (statistics.median(values) for values in zip(*found))
    beyond.append(statistics.median(w - i for w, i in found))
    print(f"| {name} | {whole:.1f} | {infer:.1f} | {beyond[-1]:.2f} |")
print(
    f"\nEverything else is {beyond[1] / beyond[0]:.1f} times cheaper, without the bytes alone "
    f"{(beyond[1] - beyond[2]) / (beyond[0] - beyond[2]):.1f} times; medians of {requests} answers each, in turns."
)
