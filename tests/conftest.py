"""Settings that all tests share."""

from hypothesis import settings

# The first example of a property may compile the kernel that it tests; no example is judged by the clock.
settings.register_profile("wayfield", deadline=None)
settings.load_profile("wayfield")
