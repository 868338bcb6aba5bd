"""Curved surfaces in point clouds: fits, detection."""
