"""What a program does, for a control engineer to read."""
