"""What drove a recording without a period: its controller, or one that stands in for it, and what noise it fed back."""
