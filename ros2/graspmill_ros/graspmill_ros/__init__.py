"""Graspmill's planner as a ROS 2 node: ``sensing`` and ``planning`` are without ROS, ``node`` is the node."""
