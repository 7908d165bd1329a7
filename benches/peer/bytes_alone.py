"""A service that does nothing: takes a request's bytes, and answers with as many as it was started with. What is left is the client's own
time and the kernel's, which no service can do without.

    bytes_alone.py PORT BYTES
"""

import re
import socket
import sys

port, count = int(sys.argv[1]), int(sys.argv[2])
ANSWER = f"HTTP/1.1 200 OK\r\ncontent-length: {count}\r\nx-infer-ms: 0\r\n\r\n".encode() + bytes(count)
room = bytearray(1 << 20)

with socket.create_server(("127.0.0.1", port)) as listener:
    while True:
        connection, _ = listener.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with connection:
            while head := connection.recv(1 << 16):
                while b"\r\n\r\n" not in head:
                    head += connection.recv(1 << 16)
                length = re.search(rb"content-length: (\d+)", head, re.IGNORECASE)
                missing = int(length[1]) if length else 0
                missing -= len(head) - head.index(b"\r\n\r\n") - 4
                while missing > 0:
                    missing -= connection.recv_into(room, min(missing, len(room)))
                connection.sendall(ANSWER)
