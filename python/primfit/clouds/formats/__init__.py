"""Formats of clouds: each module has `read`, from a path to a Cloud, and `write`, back again."""
