"""Logs of manually driven robots as recorded episodes: read with rosbags, without ROS."""
