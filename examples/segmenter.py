"""A segmenter of your own: hears `image`, answers with `mask/compressed`.

Put any method into ``coverage``; levels between 0 and 255 give sub-pixel outlines.
"""

import cv2
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CompressedImage, Image


def coverage(grey):
    """How much of each pixel (h, w) the object covers, 255: all of it; here, how dark it is."""
    dark, light = np.percentile(grey, (2, 98))
    return np.clip(255 * (light - grey.astype(float)) / max(light - dark, 1), 0, 255).round()


class Segmenter(Node):
    def __init__(self, **kwargs):
        super().__init__("segmenter", **kwargs)
        self.masks = self.create_publisher(
            CompressedImage, "mask/compressed", qos_profile_sensor_data
        )
        self.create_subscription(Image, "image", self.on_image, qos_profile_sensor_data)

    def on_image(self, msg):  # of mono8
        grey = np.frombuffer(msg.data, np.uint8).reshape(msg.height, msg.step)[:, : msg.width]
        png = cv2.imencode(".png", coverage(grey).astype(np.uint8))[1]
        self.masks.publish(CompressedImage(header=msg.header, format="png", data=png.tobytes()))


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(Segmenter())
