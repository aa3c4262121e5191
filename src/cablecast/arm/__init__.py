"""Kinematics and limits of the robot arm, vectorised over many poses."""
