"""A ROS 2 node for whatever publishes sensor_msgs/PointCloud2 (Gazebo, Isaac Sim, CARLA, Autoware, a rosbag): scans from `points_in`, realistic
ones to `points_out`, with the same header and fields. Messages are passed on as they travel; nothing is unpacked here.

    python3 plugins/ros2_node.py --ros-args -p url:=http://127.0.0.1:8080 -p model:=hdl64e -r points_in:=/lidar/points -r points_out:=/lidar/realistic
"""

import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2

from realbeam import Client, Latest


class Realbeam(Node):
    """The node. A scan that comes while an older one waits takes its place."""

    def __init__(self):
        super().__init__("realbeam")
        url = self.declare_parameter("url", "http://127.0.0.1:8080").value
        model = self.declare_parameter("model", "").value
        seed = self.declare_parameter("seed", -1).value
        client = Client(url, model=model or None, seed=seed if seed >= 0 else None)
        publisher = self.create_publisher(PointCloud2, "points_out", qos_profile_sensor_data)
        self.latest = Latest(
            client.point_cloud2,
            lambda scan: publisher.publish(scan.data),
            lambda error: self.get_logger().error(f"a scan is lost: {error}"),
        )
        self.create_subscription(PointCloud2, "points_in", self.latest, qos_profile_sensor_data, raw=True)


def main():
    rclpy.init()
    node = Realbeam()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.latest.close()
        node.destroy_node()


if __name__ == "__main__":
    main()
