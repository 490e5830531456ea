"""ROS messages <-> arrays, strictly checked; message classes from one import point."""
