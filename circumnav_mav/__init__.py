"""Circle a target whose place nobody knows, from range alone, without GPS."""

__version__ = "0.1.0"
