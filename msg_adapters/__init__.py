"""ROS messages <-> arrays, strictly checked.

Decoders (`image`, `camera_info`, `stamp`, `text`) work on any object with the fields of the message (rclpy's,
rosbags', a test's) and import no ROS. Encoders (`encode_*`) build rclpy messages; their classes come from
`msg_adapters.messages`, the one import point.

`msg_adapters` is a global module name: keep it small, and let nobody else install one.
"""
