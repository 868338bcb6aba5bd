"""Worlds, scans, clouds, planes and detections as scenes in space."""
