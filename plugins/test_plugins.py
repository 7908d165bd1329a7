"""Against a running service whose default model has 16 rings and 360 columns:

    REALBEAM_URL=http://127.0.0.1:8080 python3 plugins/test_plugins.py

CARLA and ROS 2 are stood in for by the few members that the plugins use.
"""

import math
import os
import pathlib
import socket
import struct
import sys
import threading
import types
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import realbeam

URL = os.environ["REALBEAM_URL"]
RINGS, COLUMNS = 16, 360


class LidarMeasurement:
    """Ring after ring, y to the right, as CARLA gives it, all of it to the left; `count` is what it says of every ring."""

    def __init__(self, frame=1, rings=RINGS, count=COLUMNS // 2):
        self.frame, self.channels, self.count = frame, rings, count
        self.points = []
        for ring in range(rings):
            for column in range(COLUMNS // 2):
                range_m = 5 + (ring * 37 + column * 11) % 400 * 0.1
                elevation = math.radians(15 - 2 * ring)
                azimuth = math.pi - math.radians(column + 0.5)
                flat = range_m * math.cos(elevation)
                point = flat * math.cos(azimuth), -flat * math.sin(azimuth), range_m * math.sin(elevation), 0.5
                self.points.append(struct.unpack("<4f", struct.pack("<4f", *point)))
        self.raw_data = memoryview(b"".join(struct.pack("<4f", *point) for point in self.points))

    def get_point_count(self, channel):
        assert channel < self.channels
        return self.count


class SemanticLidarMeasurement(LidarMeasurement):
    """With the tag of roads, and one object's number."""

    def __init__(self):
        super().__init__()
        self.raw_data = memoryview(b"".join(struct.pack("<4f2I", *point[:3], 1.0, 7, 1) for point in self.points))


def counted(scan):
    """Points of a scan before and after, as the service counts them."""
    return tuple(int(scan.headers[f"x-realbeam-points-{name}"]) for name in ("in", "kept"))


class Client(unittest.TestCase):
    def setUp(self):
        self.client = realbeam.Client(URL, seed=7)
        self.addCleanup(self.client.close)

    def test_a_scan_of_carla_comes_back_in_carlas_layout_and_frame(self):
        measurement = LidarMeasurement(frame=12)
        with self.assertLogs("realbeam", "WARNING") as logged:
            scan = self.client.carla(measurement)
        self.assertIn("180 of 360 degrees", logged.output[0])
        points = list(struct.iter_unpack("<4f", scan.data))
        self.assertEqual((len(measurement.points), len(points)), counted(scan))
        self.assertLess(len(points), len(measurement.points), "some rays are lost")
        with self.assertNoLogs("realbeam"):
            self.client.carla(measurement)
        self.assertTrue(all(y < 0 for _, y, _, _ in measurement.points) and all(y < 0 for _, y, _, _ in points))
        self.assertEqual(scan.headers["x-request-id"], "carla-12")
        self.assertEqual(scan.headers["x-realbeam-seed"], "7")

    def test_carlas_counts_tell_the_rings_where_there_are_as_many(self):
        with self.assertRaisesRegex(realbeam.Refused, "112 points"):
            self.client.carla(LidarMeasurement(count=7))
        few = LidarMeasurement(rings=9, count=7)
        self.assertEqual(counted(self.client.carla(few))[0], len(few.points))

    def test_a_semantic_scan_keeps_its_tags_and_objects(self):
        scan = self.client.carla(SemanticLidarMeasurement())
        records = list(struct.iter_unpack("<4f2I", scan.data))
        self.assertEqual(len(records), counted(scan)[1])
        self.assertEqual({record[4:] for record in records}, {(7, 1)})
        with realbeam.Client(URL, noise="median", tags="0.9.13") as older:
            self.assertEqual({tag[4] for tag in struct.iter_unpack("<4f2I", older.carla(SemanticLidarMeasurement()).data)}, {7})

    def test_another_format_may_be_asked_for(self):
        self.assertTrue(self.client.carla(LidarMeasurement(), accept="model/x-ply").data.startswith(b"ply\n"))

    def test_what_is_refused_says_why(self):
        with self.assertRaises(realbeam.Refused) as refused:
            with realbeam.Client(URL, model="no-such") as client:
                client.carla(LidarMeasurement())
        self.assertEqual((refused.exception.status, refused.exception.code), (404, "model_not_found"))
        with self.assertRaises(realbeam.Refused) as refused:
            self.client.scan(b"12345")
        self.assertEqual((refused.exception.status, refused.exception.code), (400, "malformed_scan"))
        self.assertIn("400 malformed_scan: ", str(refused.exception))
        with self.assertRaisesRegex(ValueError, "expected http"):
            realbeam.Client("127.0.0.1:8080")

    def test_a_connection_that_was_closed_is_opened_again(self):
        first = self.client.carla(LidarMeasurement())
        self.client._connection.sock.shutdown(socket.SHUT_RDWR)
        self.assertTrue(self.client.carla(LidarMeasurement()).data == first.data)

    def test_no_service_is_an_oserror(self):
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        with self.assertRaises(OSError):
            realbeam.Client(f"http://127.0.0.1:{port}").scan(b"")


class Latest(unittest.TestCase):
    def test_the_newest_scan_is_never_lost_and_older_ones_give_way(self):
        busy, go, answered = threading.Event(), threading.Event(), []

        def ask(scan):
            busy.set()
            go.wait(60)
            return scan

        latest = realbeam.Latest(ask, answered.append)
        latest(0)
        self.assertTrue(busy.wait(60))
        for scan in range(1, 50):
            latest(scan)
        go.set()
        latest.close()
        self.assertEqual((answered, latest.superseded), ([0, 49], 48))

    def test_one_that_fails_does_not_stop_the_others(self):
        client, failed, answered, lost = realbeam.Client(URL), [], [], threading.Event()
        self.addCleanup(client.close)
        latest = realbeam.Latest(client.carla, answered.append, lambda error: (failed.append(error), lost.set()))
        broken = LidarMeasurement()
        broken.raw_data = b"12345"
        latest(broken)
        self.assertTrue(lost.wait(60))
        latest(LidarMeasurement())
        latest.close()
        self.assertEqual((len(answered), [error.status for error in failed]), (1, [400]))


class Ros2(unittest.TestCase):
    def test_a_message_is_passed_on_as_it_travels(self):
        topics = {}

        class Node:
            def __init__(self, name):
                self.parameters = {"url": URL, "seed": 7}

            def declare_parameter(self, name, default):
                return types.SimpleNamespace(value=self.parameters.get(name, default))

            def create_publisher(self, kind, topic, qos):
                return types.SimpleNamespace(publish=topics.setdefault(topic, []).append)

            def create_subscription(self, kind, topic, callback, qos, raw=False):
                assert raw
                topics[topic] = callback

            def get_logger(self):
                return types.SimpleNamespace(error=self.fail)

            def fail(self, words):
                topics.setdefault("errors", []).append(words)

        for name, members in {
            "rclpy": {},
            "rclpy.node": {"Node": Node},
            "rclpy.qos": {"qos_profile_sensor_data": None},
            "sensor_msgs": {},
            "sensor_msgs.msg": {"PointCloud2": None},
        }.items():
            sys.modules[name] = types.ModuleType(name)
            vars(sys.modules[name]).update(members)
        import ros2_node

        client = realbeam.Client(URL, seed=7)
        self.addCleanup(client.close)
        message = client.scan(LidarMeasurement().raw_data, "application/vnd.carla.lidar", "application/cdr").data
        node = ros2_node.Realbeam()
        topics["points_in"](message)
        node.latest.close()
        self.assertNotIn("errors", topics)
        self.assertTrue(topics["points_out"] == [client.point_cloud2(message).data])


if __name__ == "__main__":
    unittest.main()
