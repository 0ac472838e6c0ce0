"""The shepherding world: pure functions over typed pytrees, in jax alone."""
