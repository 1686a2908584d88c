"""The vehicles of a run in ROS while it goes on: `uav-cosim run --ros2` and `--ros1`.

feed        the observer that publishes poses, odometry, geodetic positions, tf, MAVLink packets and the clock
setpoints   poses, velocities and packets from ROS, which enter the network as those of a ground station
mavlink     MAVLink packets as messages of ROS, and back
ros2        topics of ROS 2, by DDS
ros1        topics of ROS 1, by a program that ROS's own Python runs
"""
