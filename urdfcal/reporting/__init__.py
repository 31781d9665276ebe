"""What a report of a calibration says, and its page, Markdown and pictures."""
