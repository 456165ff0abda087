"""The paper's experiments (Dong, Xie and Shi 2021), each in a module of its own."""
