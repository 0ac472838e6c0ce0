"""What the command `skydog` does: one file per command."""
