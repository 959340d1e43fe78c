"""PURE: laws, estimators, limits and phases. No clock, no input or output, no MAVLink."""
