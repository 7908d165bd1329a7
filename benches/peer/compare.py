"""Realbeam's service and the one in peer.py, asked in turns for the same scan in one run, ten scans at
a time, each 50 ms after the answer before.

    scripts/bench_peer.sh SCAN.bin [REQUESTS]

Prints medians in ms: the whole answer as a client sees it, the model's own run as the service tells it, and what is left, which is all
that a service adds: HTTP, decoding, projection, ray drop, reconstruction, encoding. The client is the same for both. The last line is what
the client and the kernel need for the bytes of such an answer alone (bytes_alone.py): nobody can be cheaper.
"""

import pathlib
import re
import socket
import statistics
import subprocess
import sys
import time

ours, peer, scan, requests = int(sys.argv[1]), int(sys.argv[2]), open(sys.argv[3], "rb").read(), int(sys.argv[4])


def infer_ms(head):
    timing = re.search(r"server-timing:.*infer;dur=([\d.]+)", head) or re.search(r"x-infer-ms: *([\d.]+)", head)
    return float(timing[1])


class Client:
    """A client that does no more than it must: its own work would be counted as the services'."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.answer = memoryview(bytearray(len(scan) + (1 << 16)))

    def ask(self, seed):
        """The time of the whole answer, of the model's own run, and the answer's length."""
        time.sleep(0.05)
        started = time.perf_counter()
        self.socket.sendall(
            f"POST /v1/scan?seed={seed} HTTP/1.1\r\nhost: x\r\ncontent-type: application/octet-stream\r\n"
            f"content-length: {len(scan)}\r\n\r\n".encode()
        )
        self.socket.sendall(scan)
        came, end = 0, -1
        while end < 0:
            came += self.receive(came)
            end = self.answer.obj.find(b"\r\n\r\n", 0, came)
        head = bytes(self.answer[:end]).decode().lower()
        length = int(re.search(r"content-length: *(\d+)", head)[1])
        while came < end + 4 + length:
            came += self.receive(came)
        whole = (time.perf_counter() - started) * 1e3
        assert head.startswith("http/1.1 200 ") and length > len(scan) // 4, head
        return whole, infer_ms(head), length

    def receive(self, came):
        count = self.socket.recv_into(self.answer[came:])
        assert count, "the answer ends too early"
        return count


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


clients = {"realbeam-server": Client(ours), "FastAPI, numpy": Client(peer)}
process, port = start_bytes_alone(clients["realbeam-server"].ask(0)[2])
clients["the bytes alone"] = Client(port)
times = {name: [] for name in clients}
for first in range(0, requests, 10):
    for name, client in clients.items():
        # The other one's threads may spin for half a second.
        time.sleep(1)
        # The first two warm up.
        times[name] += [client.ask(seed)[:2] for seed in range(first, first + 12)][2:]
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
