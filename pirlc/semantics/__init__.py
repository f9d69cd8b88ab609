"""What programs mean: the reference interpreter, and the evaluator over many histories at once."""
