"""Terms as symbolic expressions, for tuning and for proofs."""
