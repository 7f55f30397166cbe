"""The compiled lane simulator: layout, exact chains, step, lanes, batches."""
