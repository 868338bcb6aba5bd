"""Solids by the likelihood of all ranges: seeds, competing kinds, repair, uncertainty."""
