"""The shepherding world: pure functions over typed trees, nothing but jax."""
