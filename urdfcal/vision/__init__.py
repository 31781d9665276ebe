"""Pictures: the camera's lens, the screen in front of it, the marker sheets, the spots on it."""
