"""Logs of robots that people drove, as recorded episodes: read with rosbags, without ROS."""
