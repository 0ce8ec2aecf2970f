"""Folders of ROS 2 recordings."""
