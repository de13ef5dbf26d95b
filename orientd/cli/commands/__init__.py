"""The commands of `orientd`, a module for each group of them."""
