"""One adapter (`benchmarks.problem.Adapter`) for each solver or family of solvers."""
