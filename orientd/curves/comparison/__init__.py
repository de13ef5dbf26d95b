"""Every family on the same keyframes, and what each of them does in figures."""
