"""Scans: the casting of beams, and what they returned."""
