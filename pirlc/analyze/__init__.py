"""Programs as a control engineer looks at them."""
