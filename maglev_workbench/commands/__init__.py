"""One folder for every command of `maglev`."""
