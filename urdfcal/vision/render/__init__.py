"""The pictures that a camera would take."""
