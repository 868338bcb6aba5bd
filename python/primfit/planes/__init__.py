"""Planes: of scans, by RANSAC along the beams; of clouds of which nothing is known."""
