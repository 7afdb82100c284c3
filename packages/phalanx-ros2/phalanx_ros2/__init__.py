"""ROS 2 over rmw_zenoh, without ROS installed: names, types, bytes, and robots."""
