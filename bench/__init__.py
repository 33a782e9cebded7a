"""What this machine can do: the parts of `make bench`."""
