"""Fields of ROS messages -> arrays, strictly checked; imports no ROS.

The live node (through `msg_adapters`) and the reader of bags decode by the same code: what one refuses, the other does.
"""
