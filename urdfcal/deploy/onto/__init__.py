"""A calibration put onto a robot's other descriptions: MuJoCo's MJCF and Gazebo's SDF, of whose bytes nothing but numbers changes."""
