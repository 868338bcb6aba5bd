"""Shapes by themselves: outlines, prisms over them, closed surfaces of flat faces."""
