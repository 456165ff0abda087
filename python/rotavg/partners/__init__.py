"""Measurement graphs and solutions as objects of other libraries, and back."""
