"""Proofs about programs and about the C made from them."""
