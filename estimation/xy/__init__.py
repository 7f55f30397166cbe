"""Two axes together: the eight coefficients of a bearing from recordings in x and y."""
