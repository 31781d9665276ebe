"""Robot, beams, screen and readings in a meshcat tab."""
