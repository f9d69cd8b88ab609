"""The study: every optimiser and every ablation of the paper, beside what people use today."""
