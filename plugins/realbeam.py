"""Realbeam from a simulator's Python: a scan goes in, the realistic one comes out. Needs nothing but the standard library.

CARLA, synchronous mode, where a tick waits for its scan (world and lidar as in CARLA's own examples; README.md says which attributes to set):

    client = realbeam.Client("http://127.0.0.1:8080", model="hdl64e")
    scans = queue.Queue()
    lidar.listen(scans.put)
    world.tick()
    points = numpy.frombuffer(client.carla(scans.get()).data, numpy.float32).reshape(-1, 4)

Asynchronous mode, where nobody waits and a newer scan takes the place of one that has not been sent yet:

    lidar.listen(realbeam.Latest(client.carla, show))
"""

import http.client
import json
import logging
import os
import ssl
import threading
import urllib.parse

log = logging.getLogger("realbeam")


class Refused(Exception):
    """The service's answer to a scan that it does not take: HTTP's `status`, the error's `code`, and `args[0]`, its words."""

    def __init__(self, status, code, words):
        super().__init__(words)
        self.status, self.code = status, code

    def __str__(self):
        return f"{self.status} {self.code}: {self.args[0]}"


class Scan:
    """A realistic scan: `data`, its bytes, in the format that was asked for, and `headers`, what the service says of it."""

    def __init__(self, data, headers):
        self.data, self.headers = data, headers


class Client:
    """A service, over one connection that is kept. Threads may share a client; their scans go one after the other.

    `noise` and `tags` are the service's (`tags="0.9.13"` for CARLA up to that version). `token` is the service's token, if it has one (or
    REALBEAM_TOKEN); `context` an `ssl.SSLContext` for https with a certificate of
    one's own.
    """

    def __init__(self, url, model=None, seed=None, noise=None, tags=None, token=None, timeout_s=30.0, context=None):
        address = urllib.parse.urlsplit(url)
        if address.scheme not in ("http", "https") or not address.hostname:
            raise ValueError(f"{url!r} is no address of a service: expected http://HOST:PORT or https://HOST:PORT")
        if address.scheme == "https":
            context = context or ssl.create_default_context()
            self._connection = http.client.HTTPSConnection(address.hostname, address.port, timeout=timeout_s, context=context)
        else:
            self._connection = http.client.HTTPConnection(address.hostname, address.port, timeout=timeout_s)
        asked = {"model": model, "seed": seed, "noise": noise, "tags": tags}
        query = urllib.parse.urlencode({key: value for key, value in asked.items() if value is not None})
        self._path = address.path.rstrip("/") + "/v1/scan" + ("?" + query if query else "")
        self._info_path = address.path.rstrip("/") + "/info"
        token = token or os.environ.get("REALBEAM_TOKEN")
        self._headers = {"authorization": f"Bearer {token}"} if token else {}
        self._model, self._rings, self._warned = model, None, set()
        self._lock = threading.Lock()

    def scan(self, data, content_type="application/octet-stream", accept=None, headers=None):
        """Makes a scan realistic: `data` in one of the service's media types, the answer in `accept`, or else in the same.

        Raises `Refused` with the service's reason, or `OSError` where there is no service."""
        headers = {**(headers or {}), "content-type": content_type, "accept": accept or content_type}
        answer, data = self._ask("POST", self._path, data, headers)
        warning = answer.headers.get("x-realbeam-warning")
        if warning and warning not in self._warned:
            # A simulator is set up once, and its scans say the same many times a second.
            self._warned.add(warning)
            log.warning("%s", warning)
        return Scan(data, answer.headers)

    def carla(self, measurement, accept=None):
        """Makes a `carla.LidarMeasurement` or `carla.SemanticLidarMeasurement` realistic, in CARLA's own layout and frame.

        Where the sensor has as many channels as the model has rings, CARLA's own counts of points tell each point's ring."""
        semantic = type(measurement).__name__.startswith("Semantic")
        kind = "application/vnd.carla.semantic-lidar" if semantic else "application/vnd.carla.lidar"
        headers = {"x-request-id": f"carla-{measurement.frame}"}
        if measurement.channels == self.rings():
            counts = (measurement.get_point_count(channel) for channel in range(measurement.channels))
            headers["x-ring-counts"] = ",".join(map(str, counts))
        return self.scan(measurement.raw_data, kind, accept, headers)

    def point_cloud2(self, message, accept=None):
        """Makes a ROS 2 `sensor_msgs/PointCloud2` realistic, serialised as it travels (CDR); so is the answer, with the same header and
        fields."""
        return self.scan(message, "application/cdr", accept)

    def rings(self):
        """How many rings the model has."""
        if self._rings is None:
            _, data = self._ask("GET", self._info_path, None, {})
            info = json.loads(data)
            name = self._model or info["default_model"]
            found = [model for model in info["models"] if model["name"] == name]
            if not found:
                raise Refused(404, "model_not_found", f"no model `{name}`; there are {[m['name'] for m in info['models']]}")
            self._rings = len(found[0]["card"]["sensor"]["elevation_deg"])
        return self._rings

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Closes the connection; a scan after that opens it again."""
        with self._lock:
            self._connection.close()

    def _ask(self, method, path, data, headers):
        with self._lock:
            try:
                answer, data = self._once(method, path, data, headers)
            except (ConnectionError, http.client.BadStatusLine):
                # The service closes a connection that has been idle for long. The same scan gives the same answer, asked once or twice.
                self._connection.close()
                answer, data = self._once(method, path, data, headers)
        if answer.status == 200:
            return answer, data
        try:
            error = json.loads(data)
            raise Refused(answer.status, error["code"], error["error"])
        except (ValueError, KeyError, TypeError):
            raise Refused(answer.status, "unknown", answer.reason) from None

    def _once(self, method, path, data, headers):
        try:
            self._connection.request(method, path, data, {**self._headers, **headers})
            answer = self._connection.getresponse()
            return answer, answer.read()
        except BaseException:
            # Half an answer would be taken for the next one's.
            self._connection.close()
            raise


class Latest:
    """A sensor's callback that never waits: it keeps the newest scan, and a thread of its own sends one after the other.

    `ask` makes a scan realistic (`client.carla`), `then` is given each answer, `failed` each error of either (by default it is logged). A scan that a newer one
    replaces before it is sent is counted in `superseded`."""

    def __init__(self, ask, then, failed=None):
        self._ask, self._then = ask, then
        self._failed = failed or (lambda error: log.error("a scan is lost: %s", error, exc_info=error))
        self._changed = threading.Condition()
        self._pending, self._closed = [], False
        self.superseded = 0
        self._thread = threading.Thread(target=self._work, name="realbeam", daemon=True)
        self._thread.start()

    def __call__(self, scan):
        with self._changed:
            self.superseded += len(self._pending)
            self._pending = [scan]
            self._changed.notify()

    def close(self):
        """Sends what is still to be sent, and ends the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _work(self):
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._pending or self._closed)
                if not self._pending:
                    return
                scan = self._pending.pop()
            try:
                self._then(self._ask(scan))
            except Exception as error:
                self._failed(error)
