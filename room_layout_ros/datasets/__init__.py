"""Sources of RgbdFrame: frames folders, NYU v2 .mat, rosbag2, synthetic rooms."""
