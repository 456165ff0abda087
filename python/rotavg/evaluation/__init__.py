"""How good an answer is beside a reference, and how hard a graph is."""
