"""Ranging: decoders, the receiver they share, calibration and the monitor."""
