"""ROS-free but stateful: pairing of streams, the live loop, health counters."""
