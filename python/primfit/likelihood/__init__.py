"""Solids by the likelihood of all ranges: free space, competing kinds, refinement, uncertainty."""
