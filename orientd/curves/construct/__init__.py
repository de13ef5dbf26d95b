"""What constructions of curves share: bases, increments, triangles, jets, ends."""
