"""Clouds of points: in files, and what their neighbourhoods tell of noise, normals, clusters."""
