"""A run in the viewers of others: Rerun, and live in Foxglove and ROS 2."""
