"""Scans: the sensor, the casting of its beams, and what they returned."""
