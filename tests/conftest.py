from hypothesis import settings

# No deadline: the first example of each shape waits for a compilation.
settings.register_profile("skydog", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("skydog")
