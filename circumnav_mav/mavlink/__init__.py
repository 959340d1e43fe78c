"""SANS-IO: MAVLink frames, the autopilot as its messages show it, OFFBOARD, setpoints. No sockets, no clock."""
