"""Worlds of solids with known truth, and the paths on which a sensor goes through them."""
