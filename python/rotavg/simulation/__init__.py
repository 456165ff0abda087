"""Graphs with known rotations, made at random."""
