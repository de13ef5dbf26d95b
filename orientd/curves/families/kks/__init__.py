"""The curves of Kim, Kim and Shin (1995): sums of cumulative bases."""
