"""A run for ROS 2: poses, markers and diagnostics as nodes over rmw_zenoh read them."""
