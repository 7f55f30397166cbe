"""A judge that learns: its constants, its trust and its sets, from campaigns whose truth is known."""
