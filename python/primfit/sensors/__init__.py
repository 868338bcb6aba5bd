"""Sensors: where beams go, what comes back, and how well it is measured."""
