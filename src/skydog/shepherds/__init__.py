"""Who steers: each shepherd is a function (world, state) -> velocities of the dogs in m/s."""
