"""What people would use today in place of pirlc, on the same oracles, episodes and seeds."""
