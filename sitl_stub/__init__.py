"""A pure-Python MAVLink vehicle with PX4's offboard rules, for testing companion apps without hardware."""

__version__ = "0.1.0"
