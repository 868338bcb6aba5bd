"""Solids of any shape from bounded planes: which of them meet, and how they close."""
