"""What is looked for without being asked."""
