"""Solids: what worlds are made of and what is found, with flat faces or round."""
