"""Many robots of one model: each calibrated by itself, and what all of them say of each."""
