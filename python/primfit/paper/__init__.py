"""The paper's method: planes, then corners and cycles, then kinds."""
