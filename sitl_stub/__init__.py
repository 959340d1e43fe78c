"""A pure-Python MAVLink vehicle with PX4's offboard rules, for testing companion apps without hardware."""

from sitl_stub.config import StubConfig
from sitl_stub.running import Vehicle, running
from sitl_stub.stub import Stub
from sitl_stub.truth import Truth

__all__ = ["Stub", "StubConfig", "Truth", "Vehicle", "running"]
__version__ = "0.1.0"
