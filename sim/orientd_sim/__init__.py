"""Emulated devices on real sockets and pseudo-terminals, and the models that move them."""
