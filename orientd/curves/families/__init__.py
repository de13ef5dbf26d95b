"""The families of curves that the papers describe, a module for each."""
