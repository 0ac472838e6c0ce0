"""The laboratory: motion capture in, commands out, and a clock. It runs `skydog.flight`."""
