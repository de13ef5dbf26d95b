"""Make pages from the code when the documentation is built, so that nothing is said twice."""
